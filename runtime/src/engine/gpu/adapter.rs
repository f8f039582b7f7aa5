//! Which adapter draws, and with what: hardware before software, and nothing requested that the program does not use.

use super::errors::{GpuError, GpuErrorKind, Watch};
use super::pipelines::CacheFile;
use compiler::program::kernel::{Kernel, ResourceKind};
use compiler::program::{Binding, MOST_BRICKS, Precision, Program, used_resources};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

/// Most bytes of records (or rays) that one dispatch writes: bounds the memory of tiles, and fits every adapter.
pub(super) const TILE_BYTES: u64 = 32 << 20;
/// Pixels of the largest tile that is drawn into, on an axis: what every adapter takes.
pub(super) const TARGET_SIDE: u32 = 8192;
/// Bytes of the splats of a picture: what every adapter takes.
const SPLAT_BYTES: u64 = 128 << 20;

/// Which adapter is wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AdapterChoice {
    /// A part of its name, case ignored; `None` takes the best.
    pub name: Option<String>,
    /// Takes it for one that cannot blend 32-bit floating point, to see what is drawn there.
    pub without_f32_blending: bool,
}

impl AdapterChoice {
    /// The environment variable that names an adapter.
    pub const VARIABLE: &'static str = "TYNDALL_ADAPTER";

    /// What [`Self::VARIABLE`] asks for.
    #[must_use]
    pub fn from_env() -> Self {
        Self { name: std::env::var(Self::VARIABLE).ok().filter(|n| !n.is_empty()), ..Self::default() }
    }

    fn accepts(&self, info: &wgpu::AdapterInfo) -> bool {
        self.name.as_ref().is_none_or(|n| info.name.to_lowercase().contains(&n.to_lowercase()))
    }
}

/// What an adapter is.
#[derive(Copy, Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// A card of its own.
    Discrete,
    /// Part of the processor.
    Integrated,
    /// A device lent by a host.
    Virtual,
    /// Unknown.
    Other,
    /// A driver that computes on the processor.
    Software,
}

impl AdapterKind {
    /// Its name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Other => "other",
            Self::Software => "software",
        }
    }

    fn of(info: &wgpu::AdapterInfo) -> Self {
        match info.device_type {
            wgpu::DeviceType::DiscreteGpu => Self::Discrete,
            wgpu::DeviceType::IntegratedGpu => Self::Integrated,
            wgpu::DeviceType::VirtualGpu => Self::Virtual,
            wgpu::DeviceType::Other => Self::Other,
            wgpu::DeviceType::Cpu => Self::Software,
        }
    }
}

/// What a machine offers, for reports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterReport {
    /// As the driver calls it.
    pub name: String,
    /// `vulkan`, `metal`, `dx12`, …
    pub api: String,
    /// What it is.
    pub kind: AdapterKind,
    /// Name and version of the driver.
    pub driver: String,
    /// Largest side of a grid in voxels.
    pub max_grid: u32,
    /// Most bytes of one storage buffer.
    pub max_storage: u64,
    /// Most grids in one scene.
    pub max_grids: u32,
    /// Whether it measures its own time.
    pub timestamps: bool,
    /// Whether compiled pipelines can be kept from run to run.
    pub pipeline_cache: bool,
}

impl AdapterReport {
    fn of(adapter: &wgpu::Adapter) -> Self {
        let (info, limits, features) = (adapter.get_info(), adapter.limits(), adapter.features());
        Self {
            kind: AdapterKind::of(&info),
            api: info.backend.to_str().to_owned(),
            driver: [info.driver.as_str(), info.driver_info.as_str()].join(" ").trim().to_owned(),
            name: info.name,
            max_grid: limits.max_texture_dimension_3d,
            max_storage: limits.max_storage_buffer_binding_size,
            max_grids: limits.max_sampled_textures_per_shader_stage,
            timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
            pipeline_cache: features.contains(wgpu::Features::PIPELINE_CACHE),
        }
    }
}

/// Every adapter of the machine, in the order of preference.
#[must_use]
pub fn adapters() -> Vec<AdapterReport> {
    enumerate().iter().map(AdapterReport::of).collect()
}

fn enumerate() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    // Layers of the driver are for its own developers; they are not installed on most machines.
    descriptor.flags = wgpu::InstanceFlags::empty().with_env();
    let backends = wgpu::Backends::PRIMARY.with_env();
    descriptor.backends = backends;
    let instance = wgpu::Instance::new(descriptor);
    let mut found = pollster::block_on(instance.enumerate_adapters(backends));
    let compute = wgpu::DownlevelFlags::COMPUTE_SHADERS;
    found.retain(|a| a.get_downlevel_capabilities().flags.contains(compute));
    found.sort_by_key(|a| AdapterKind::of(&a.get_info()));
    found
}

/// What a program needs of an adapter beyond the least.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Largest side of a grid, and which grid that is.
    pub grid: Option<(u32, String)>,
    /// Grids.
    pub textures: u32,
    /// Storage buffers of a kernel at most.
    pub storage_buffers: u32,
    /// Bytes of the largest storage buffer.
    pub storage_bytes: u64,
    /// Bytes of the uniform block, 0 when there is none.
    pub uniform_bytes: u64,
    /// Bindings.
    pub bindings: u32,
    /// Largest workgroup on each axis.
    pub workgroup: [u32; 3],
    /// Most invocations of a workgroup.
    pub invocations: u32,
    /// Bytes that they share.
    pub shared_bytes: u32,
    /// Targets to draw into, and bytes of a pixel of all of them.
    pub targets: [u32; 2],
    /// Whether some of them are blended in f32.
    pub blends_f32: bool,
}

impl Needs {
    /// What this program needs, of all its parts the most.
    #[must_use]
    pub fn of(program: &Program) -> Self {
        program.parts().map(Self::of_part).reduce(Self::or).unwrap_or_default()
    }

    /// The larger of both.
    fn or(self, other: Self) -> Self {
        let side = |grid: &Option<(u32, String)>| grid.as_ref().map_or(0, |g| g.0);
        Self {
            grid: if side(&other.grid) > side(&self.grid) { other.grid } else { self.grid },
            textures: self.textures.max(other.textures),
            storage_buffers: self.storage_buffers.max(other.storage_buffers),
            storage_bytes: self.storage_bytes.max(other.storage_bytes),
            uniform_bytes: self.uniform_bytes.max(other.uniform_bytes),
            bindings: self.bindings.max(other.bindings),
            workgroup: std::array::from_fn(|i| self.workgroup[i].max(other.workgroup[i])),
            invocations: self.invocations.max(other.invocations),
            shared_bytes: self.shared_bytes.max(other.shared_bytes),
            targets: std::array::from_fn(|i| self.targets[i].max(other.targets[i])),
            blends_f32: self.blends_f32 || other.blends_f32,
        }
    }

    fn of_part(program: &Program) -> Self {
        let graph = &program.optimised.graph;
        let mut needs = Self { bindings: program.plan.bindings.len() as u32, ..Self::default() };
        for binding in &program.plan.bindings {
            match binding {
                Binding::Uniforms => needs.uniform_bytes = u64::from(program.plan.uniforms.size),
                Binding::Grid(id) => {
                    let grid = graph.grid(*id);
                    let side = grid.header.dims.into_iter().max().unwrap_or(1);
                    needs.textures += 1;
                    if needs.grid.as_ref().is_none_or(|(most, _)| side > *most) {
                        needs.grid = Some((side, grid.name.clone()));
                    }
                }
                Binding::Table(id) => {
                    let table = graph.table(*id);
                    let bytes = table.keys.len() as u64 * (u64::from(table.width) + 1) * 4;
                    needs.storage_bytes = needs.storage_bytes.max(bytes);
                }
                Binding::Mesh(id) => {
                    // Never more nodes than twice the triangles, and a first row.
                    let triangles = u64::from(program.optimised.meshes[id.0 as usize].header.triangles);
                    needs.storage_bytes = needs.storage_bytes.max(32 + triangles * (2 * 32 + 36));
                }
                Binding::Cache => {
                    let floats = program.plan.fill.as_ref().map_or(0, |f| u64::from(f.floats));
                    needs.storage_bytes = needs.storage_bytes.max(4 * floats);
                }
                Binding::Bounds(_) => {
                    needs.storage_bytes = needs.storage_bytes.max(u64::from(MOST_BRICKS) * 16);
                }
                Binding::Target(_) | Binding::Light(_) => needs.textures += 1,
                Binding::Footprints => {
                    let count: u64 = program.optimised.splats.iter().map(|s| u64::from(s.header.count)).sum();
                    let stride = program.plan.footprints.map_or(0, |f| u64::from(f.stride));
                    needs.storage_bytes = needs.storage_bytes.max((count * stride * 4).next_power_of_two());
                }
                Binding::Workgroup(_) => {}
                Binding::Reaches => {
                    let count: u64 = program.optimised.splats.iter().map(|s| u64::from(s.header.count)).sum();
                    needs.storage_bytes = needs.storage_bytes.max((count * 16).next_power_of_two());
                }
                // What is as many as entries of lists is bounded, and what is as many as splats is smaller than their tiles.
                Binding::Starts
                | Binding::StartsRead
                | Binding::Entries
                | Binding::EntriesRead
                | Binding::TileListsWritten
                | Binding::Splats
                | Binding::SplatsRead
                | Binding::TileLists
                | Binding::Order
                | Binding::Keys
                | Binding::KeysRead
                | Binding::Sorting(_)
                | Binding::Tallies => {
                    needs.storage_bytes = needs.storage_bytes.max(SPLAT_BYTES);
                }
                Binding::Survey => {
                    let pixels: u64 = program.lowered.image.size.iter().map(|n| u64::from(*n)).product();
                    needs.storage_bytes = needs.storage_bytes.max((4 * pixels).next_power_of_two());
                }
                Binding::Rays
                | Binding::Records
                | Binding::Notes
                | Binding::Carried
                | Binding::NotesRead
                | Binding::Outlines => {
                    needs.storage_bytes = needs.storage_bytes.max(TILE_BYTES);
                }
            }
        }
        for target in &program.plan.targets {
            needs.targets[0] += 1;
            needs.targets[1] += u32::from(target.channels) * 4;
            needs.blends_f32 |= target.precision == Precision::Single;
        }
        for kernel in program.plan.kernels() {
            let kernel = &program.kernels[kernel as usize];
            needs.storage_buffers = needs.storage_buffers.max(storage_buffers(kernel));
            needs.shared_bytes = needs.shared_bytes.max(kernel.shared_bytes() as u32);
            let size = kernel.workgroup();
            needs.invocations = needs.invocations.max(size.iter().product());
            needs.workgroup = std::array::from_fn(|i| needs.workgroup[i].max(size[i]));
        }
        needs
    }

    /// The limits to request, or what the adapter lacks.
    fn limits(&self, offered: &wgpu::Limits) -> Result<wgpu::Limits, GpuError> {
        let too_large = |message: String| {
            Err(GpuError::new(GpuErrorKind::TooLarge, message).hint("draw with `--engine cpu`, or on another adapter"))
        };
        if let Some((side, name)) = &self.grid
            && *side > offered.max_texture_dimension_3d
        {
            let most = offered.max_texture_dimension_3d;
            return too_large(format!("grid `{name}` is {side} voxels long; this adapter takes {most}"));
        }
        if self.textures > offered.max_sampled_textures_per_shader_stage {
            let most = offered.max_sampled_textures_per_shader_stage;
            return too_large(format!("the scene uses {} grids; this adapter takes {most}", self.textures));
        }
        if self.storage_buffers > offered.max_storage_buffers_per_shader_stage {
            let most = offered.max_storage_buffers_per_shader_stage;
            let message = format!("the scene needs {} buffers; this adapter takes {most}", self.storage_buffers);
            return too_large(message);
        }
        if self.storage_bytes > offered.max_storage_buffer_binding_size.min(offered.max_buffer_size) {
            let most = offered.max_storage_buffer_binding_size >> 20;
            let message =
                format!("the scene needs a buffer of {} MiB; this adapter takes {most}", self.storage_bytes >> 20);
            return too_large(message);
        }
        if self.uniform_bytes > offered.max_uniform_buffer_binding_size {
            let most = offered.max_uniform_buffer_binding_size;
            let message = format!("the parameters take {} bytes; this adapter takes {most}", self.uniform_bytes);
            return too_large(message);
        }
        let [targets, target_bytes] = self.targets;
        if targets > offered.max_color_attachments || target_bytes > offered.max_color_attachment_bytes_per_sample {
            let message = format!(
                "the scene is drawn into {targets} targets of {target_bytes} bytes a pixel; this adapter takes fewer"
            );
            return Err(GpuError::new(GpuErrorKind::TooLarge, message).hint("draw with `--backend raymarch`"));
        }
        // The least that WebGPU knows, and on top of it what is used. Alignments must be the adapter's own or larger.
        let least = wgpu::Limits::downlevel_webgl2_defaults();
        let dispatched = !self.workgroup.contains(&0);
        Ok(wgpu::Limits {
            max_texture_dimension_3d: self.grid.as_ref().map_or(0, |g| g.0).max(least.max_texture_dimension_3d),
            max_sampled_textures_per_shader_stage: self.textures.max(least.max_sampled_textures_per_shader_stage),
            max_storage_buffers_per_shader_stage: self.storage_buffers,
            max_storage_buffer_binding_size: self.storage_bytes,
            max_buffer_size: self.storage_bytes.max(TILE_BYTES + 512).max(least.max_buffer_size.min(TILE_BYTES)),
            max_texture_dimension_2d: if targets > 0 { TARGET_SIDE } else { least.max_texture_dimension_2d },
            max_color_attachments: targets.max(least.max_color_attachments),
            max_color_attachment_bytes_per_sample: target_bytes.max(least.max_color_attachment_bytes_per_sample),
            max_uniform_buffer_binding_size: self.uniform_bytes.max(least.max_uniform_buffer_binding_size),
            max_compute_workgroup_size_x: self.workgroup[0],
            max_compute_workgroup_size_y: self.workgroup[1],
            max_compute_workgroup_size_z: self.workgroup[2],
            max_compute_invocations_per_workgroup: self.invocations,
            max_compute_workgroup_storage_size: self.shared_bytes,
            max_compute_workgroups_per_dimension: if dispatched { 65535 } else { 0 },
            ..least
        })
    }
}

/// How many buffers of storage a kernel uses.
fn storage_buffers(kernel: &Kernel) -> u32 {
    let is_storage = |kind: ResourceKind| match kind {
        ResourceKind::ReadBuffer(_) | ResourceKind::WriteBuffer(_) => true,
        ResourceKind::Uniform(_) | ResourceKind::Workgroup(..) => false,
        ResourceKind::Texture3d(_) | ResourceKind::Texture2d => false,
    };
    let used = kernel.resources.iter().zip(used_resources(kernel));
    used.filter(|(resource, used)| *used && is_storage(resource.kind)).count() as u32
}

/// An open device.
#[derive(Debug)]
pub struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) watch: Watch,
    pub(super) cache: Option<CacheFile>,
    pub(super) timestamps: bool,
    pub(super) created: Arc<AtomicU32>,
    report: AdapterReport,
    limits: wgpu::Limits,
    features: wgpu::Features,
}

impl Gpu {
    /// Opens the best adapter that the choice allows and that can hold the program.
    ///
    /// # Errors
    /// No adapter, none of that name, none that is large enough, or no device from its driver.
    pub fn new(choice: &AdapterChoice, needs: &Needs) -> Result<Self, GpuError> {
        let all = enumerate();
        if all.is_empty() {
            return Err(GpuError::new(GpuErrorKind::NoAdapter, "this machine has no graphics adapter").hint(
                "install a driver; the package `mesa-vulkan-drivers` has one in software that needs no hardware. \
                 `--engine cpu` needs none",
            ));
        }
        let names: Vec<String> = all.iter().map(|a| a.get_info().name).collect();
        let mut failure = None;
        for adapter in all.into_iter().filter(|a| choice.accepts(&a.get_info())) {
            match Self::open(&adapter, needs, choice) {
                Ok(gpu) => return Ok(gpu),
                Err(error) => _ = failure.get_or_insert(error),
            }
        }
        Err(failure.unwrap_or_else(|| {
            let wanted = choice.name.as_deref().unwrap_or_default();
            GpuError::new(GpuErrorKind::NoAdapter, format!("no graphics adapter has `{wanted}` in its name"))
                .hint(format!("this machine has: {}", names.join(", ")))
        }))
    }

    fn open(adapter: &wgpu::Adapter, needs: &Needs, choice: &AdapterChoice) -> Result<Self, GpuError> {
        let limits = needs.limits(&adapter.limits())?;
        let optional = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::PIPELINE_CACHE;
        let mut features = adapter.features() & optional;
        if needs.blends_f32 {
            let blended = wgpu::Features::FLOAT32_BLENDABLE;
            if choice.without_f32_blending || !adapter.features().contains(blended) {
                let message = format!("`{}` cannot blend 32-bit floating point", adapter.get_info().name);
                return Err(GpuError::new(GpuErrorKind::Unblendable, message).hint("draw with `--backend raymarch`"));
            }
            features |= blended;
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("tyndall"),
            required_features: features,
            required_limits: limits.clone(),
            // One large texture and a few buffers: no use for big blocks.
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let report = AdapterReport::of(adapter);
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).map_err(|e| {
            GpuError::new(GpuErrorKind::Driver, format!("`{}` gives no device: {e}", report.name))
                .hint("update the driver, or draw with `--engine cpu`")
        })?;
        let watch = Watch::new(&device);
        let cached = features.contains(wgpu::Features::PIPELINE_CACHE);
        Ok(Self {
            cache: if cached { CacheFile::open(&device, &adapter.get_info()) } else { None },
            timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
            created: Arc::default(),
            device,
            queue,
            watch,
            report,
            limits,
            features,
        })
    }

    /// What draws.
    #[must_use]
    pub fn adapter(&self) -> &AdapterReport {
        &self.report
    }

    /// Waits until all is done that has been submitted, and gives the milliseconds since `started`.
    pub(super) fn finish(&self, started: Instant) -> Result<f64, GpuError> {
        let index = self.queue.submit([]);
        self.watch.wait(index)?;
        Ok(started.elapsed().as_secs_f64() * 1e3)
    }

    /// The limits that were requested.
    #[must_use]
    pub fn limits(&self) -> &wgpu::Limits {
        &self.limits
    }

    /// The features that were requested.
    #[must_use]
    pub fn features(&self) -> wgpu::Features {
        self.features
    }

    /// How many pipelines this device has compiled: drawing again with other parameters must not add one.
    #[must_use]
    pub fn pipelines_created(&self) -> u32 {
        self.created.load(Ordering::Relaxed)
    }
}
