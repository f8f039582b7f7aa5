//! Shader modules, layouts and pipelines, and the file that keeps compiled pipelines from run to run.

use super::adapter::Gpu;
use super::errors::{GpuError, GpuErrorKind};
use super::sorting::{ListSteps, SortSteps};
use compiler::loader::Scalar;
use compiler::program::kernel::{Prim, Stage};
use compiler::program::{Binding, Blend, Draw, Pass, Precision, Program, SortBuffer, Target, texture_prim};
use std::borrow::Cow;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// How a grid lies in a texture.
pub(super) fn texture_format(scalar: Scalar) -> wgpu::TextureFormat {
    match scalar {
        Scalar::U8 => wgpu::TextureFormat::R8Uint,
        Scalar::I8 => wgpu::TextureFormat::R8Sint,
        Scalar::U16 => wgpu::TextureFormat::R16Uint,
        Scalar::I16 => wgpu::TextureFormat::R16Sint,
        Scalar::U32 => wgpu::TextureFormat::R32Uint,
        Scalar::I32 => wgpu::TextureFormat::R32Sint,
        Scalar::F32 | Scalar::U64 | Scalar::I64 | Scalar::F64 => wgpu::TextureFormat::R32Float,
    }
}

/// `None` where nothing is bound.
fn binding_type(program: &Program, binding: Binding) -> Option<wgpu::BindingType> {
    let storage = |read_only| wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    Some(match binding {
        Binding::Uniforms => wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        Binding::Grid(id) => wgpu::BindingType::Texture {
            sample_type: match texture_prim(program.optimised.graph.grid(id).header.scalar).0 {
                Prim::U32 | Prim::Bool => wgpu::TextureSampleType::Uint,
                Prim::I32 => wgpu::TextureSampleType::Sint,
                Prim::F32 => wgpu::TextureSampleType::Float { filterable: false },
            },
            view_dimension: wgpu::TextureViewDimension::D3,
            multisampled: false,
        },
        Binding::Table(_) | Binding::Mesh(_) | Binding::Rays | Binding::NotesRead | Binding::Outlines => storage(true),
        Binding::SplatsRead | Binding::Order | Binding::Bounds(_) | Binding::KeysRead => storage(true),
        Binding::Footprints | Binding::TileLists | Binding::Reaches => storage(true),
        Binding::StartsRead | Binding::EntriesRead => storage(true),
        Binding::Starts | Binding::Entries | Binding::TileListsWritten => storage(false),
        Binding::Sorting(SortBuffer::KeysFrom | SortBuffer::NumbersFrom) => storage(true),
        Binding::Sorting(SortBuffer::KeysTo | SortBuffer::NumbersTo) => storage(false),
        Binding::Keys | Binding::Tallies | Binding::Survey => storage(false),
        Binding::Workgroup(_) => return None,
        Binding::Cache | Binding::Records | Binding::Notes | Binding::Splats | Binding::Carried => storage(false),
        Binding::Target(_) | Binding::Light(_) => wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: false },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        },
    })
}

/// A compiled pass, or the one that fills the cache.
#[derive(Debug)]
pub(super) struct Step {
    pub(super) pipeline: Pipeline,
    /// Of group 0: what this pass uses.
    pub(super) layout: wgpu::BindGroupLayout,
    /// By number of the binding.
    pub(super) used: Vec<bool>,
}

#[derive(Debug)]
pub(super) enum Pipeline {
    Compute(wgpu::ComputePipeline),
    Raster(wgpu::RenderPipeline),
    /// For rays that meet the farthest first, and for others.
    Either(wgpu::RenderPipeline, wgpu::RenderPipeline),
}

/// The compiled passes of a plan.
#[derive(Debug)]
pub(super) struct Pipelines {
    /// As the plan's.
    pub(super) passes: Vec<Step>,
    /// What light loses in a slab.
    pub(super) light: Option<Step>,
    pub(super) fill: Option<Step>,
    pub(super) plant: Option<Step>,
    pub(super) doubt: Option<Step>,
    pub(super) rank: Option<Step>,
    pub(super) survey: Option<Step>,
    pub(super) drawn: Option<Step>,
    pub(super) sort: Option<SortSteps>,
    pub(super) lists: Option<ListSteps>,
}

/// The format of a target.
pub(super) fn target_format(target: &Target) -> wgpu::TextureFormat {
    match (target.precision, target.channels) {
        (Precision::Single, 1) => wgpu::TextureFormat::R32Float,
        (Precision::Single, 2) => wgpu::TextureFormat::Rg32Float,
        (Precision::Single, _) => wgpu::TextureFormat::Rgba32Float,
        (Precision::Half, 1) => wgpu::TextureFormat::R16Float,
        (Precision::Half, 2) => wgpu::TextureFormat::Rg16Float,
        (Precision::Half, _) => wgpu::TextureFormat::Rgba16Float,
    }
}

/// How fragments come to what is there. `nearest_first`: what is to be over comes under.
fn blend(blend: Blend, nearest_first: bool) -> wgpu::BlendState {
    use wgpu::BlendFactor::{DstAlpha, One, SrcAlpha, Zero};
    use wgpu::BlendOperation::{Add, Max};
    let component = |src_factor, dst_factor, operation| wgpu::BlendComponent { src_factor, dst_factor, operation };
    let color = match blend {
        Blend::Over if nearest_first => component(DstAlpha, One, Add),
        Blend::Over => component(One, SrcAlpha, Add),
        Blend::Add => component(One, One, Add),
        Blend::Max => component(One, One, Max),
    };
    let alpha = match blend {
        Blend::Over => component(Zero, SrcAlpha, Add),
        Blend::Add | Blend::Max => color,
    };
    wgpu::BlendState { color, alpha }
}

/// What compiles the passes of one program.
struct Compiler<'a> {
    gpu: &'a Gpu,
    program: &'a Program,
    modules: Vec<wgpu::ShaderModule>,
    /// The bindings that each of them names.
    bindings: Vec<Vec<u32>>,
}

impl Compiler<'_> {
    /// What some kernels use together, and the layouts of it.
    fn layout(&self, kernels: &[u32]) -> (Vec<bool>, wgpu::BindGroupLayout, wgpu::PipelineLayout) {
        let kernel = |k: &u32| &self.program.kernels[*k as usize];
        let bindings = &self.program.plan.bindings;
        let names = |k: &&u32, i: usize| self.bindings[**k as usize].contains(&(i as u32));
        let used: Vec<bool> = (0..bindings.len()).map(|i| kernels.iter().any(|k| names(&k, i))).collect();
        let visible = |i: usize| {
            kernels.iter().filter(|k| names(k, i)).fold(wgpu::ShaderStages::NONE, |all, k| {
                all | match kernel(k).stage {
                    Stage::Compute(_) => wgpu::ShaderStages::COMPUTE,
                    Stage::Vertex => wgpu::ShaderStages::VERTEX,
                    Stage::Fragment => wgpu::ShaderStages::FRAGMENT,
                }
            })
        };
        let entries: Vec<_> = (0..bindings.len())
            .filter(|i| used[*i])
            .filter_map(|i| {
                let (binding, visibility) = (i as u32, visible(i));
                let ty = binding_type(self.program, bindings[i])?;
                Some(wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None })
            })
            .collect();
        let label = Some("plan");
        let device = &self.gpu.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries: &entries });
        let pipeline = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        (used, layout, pipeline)
    }

    fn compute(&self, kernel: u32) -> Result<Step, GpuError> {
        let (used, layout, pipeline_layout) = self.layout(&[kernel]);
        self.gpu.created.fetch_add(1, Ordering::Relaxed);
        let pipeline = self.gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(&self.program.kernels[kernel as usize].name),
            layout: Some(&pipeline_layout),
            module: &self.modules[kernel as usize],
            // A module has one entry point; its name is emit's affair.
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions {
                // Kernels write memory of a workgroup before they read it.
                zero_initialize_workgroup_memory: false,
                ..wgpu::PipelineCompilationOptions::default()
            },
            cache: self.gpu.cache.as_ref().map(|c| &c.cache),
        });
        self.gpu.watch.check()?;
        Ok(Step { pipeline: Pipeline::Compute(pipeline), layout, used })
    }

    fn raster(&self, draw: Draw, targets: &[Target]) -> Result<Step, GpuError> {
        let (used, layout, pipeline_layout) = self.layout(&[draw.vertex, draw.fragment]);
        let pipeline = Pipeline::Raster(self.render(draw, &pipeline_layout, (targets, false))?);
        Ok(Step { pipeline, layout, used })
    }

    /// What is drawn from either side.
    fn either(&self, draw: Draw) -> Result<Step, GpuError> {
        let (used, layout, pipeline_layout) = self.layout(&[draw.vertex, draw.fragment]);
        let one = |nearest_first| self.render(draw, &pipeline_layout, (&self.program.plan.targets, nearest_first));
        Ok(Step { pipeline: Pipeline::Either(one(false)?, one(true)?), layout, used })
    }

    fn render(
        &self,
        Draw { vertex, fragment }: Draw,
        pipeline_layout: &wgpu::PipelineLayout,
        (targets, nearest_first): (&[Target], bool),
    ) -> Result<wgpu::RenderPipeline, GpuError> {
        self.gpu.created.fetch_add(1, Ordering::Relaxed);
        let targets = targets.iter().map(|target| {
            Some(wgpu::ColorTargetState {
                format: target_format(target),
                blend: Some(blend(target.blend, nearest_first)),
                write_mask: wgpu::ColorWrites::ALL,
            })
        });
        let targets: Vec<_> = targets.collect();
        let pipeline = self.gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(&self.program.kernels[fragment as usize].name),
            layout: Some(pipeline_layout),
            vertex: wgpu::VertexState {
                module: &self.modules[vertex as usize],
                entry_point: None,
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &self.modules[fragment as usize],
                entry_point: None,
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: self.gpu.cache.as_ref().map(|c| &c.cache),
        });
        self.gpu.watch.check()?;
        Ok(pipeline)
    }
}

impl Pipelines {
    /// Compiles every pass. `shaders[i]` is kernel `i`, validated already.
    pub(super) fn new(gpu: &Gpu, program: &Program, shaders: Vec<naga::Module>) -> Result<Self, GpuError> {
        if shaders.len() != program.kernels.len() {
            let message = format!("{} shaders for {} kernels", shaders.len(), program.kernels.len());
            return Err(GpuError::new(GpuErrorKind::Validation, message));
        }
        let named = |shader: &naga::Module| {
            shader.global_variables.iter().filter_map(|(_, g)| Some(g.binding?.binding)).collect()
        };
        let bindings = shaders.iter().map(named).collect();
        let mut modules = vec![];
        for (kernel, shader) in program.kernels.iter().zip(shaders) {
            modules.push(gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(&kernel.name),
                source: wgpu::ShaderSource::Naga(Cow::Owned(shader)),
            }));
            gpu.watch.check()?;
        }
        let compiler = Compiler { gpu, program, modules, bindings };
        let pass = |pass: &Pass| match *pass {
            Pass::Compute { kernel, .. } | Pass::Rounds { kernel, .. } => compiler.compute(kernel),
            Pass::Raster { vertex, fragment, .. } => compiler.raster(Draw { vertex, fragment }, &program.plan.targets),
            Pass::Alternate { seen, .. } => compiler.either(seen),
        };
        let passes = program.plan.passes.iter().map(pass).collect::<Result<_, _>>()?;
        let lit = program.plan.passes.iter().find_map(|pass| match *pass {
            Pass::Alternate { light, .. } => light,
            Pass::Compute { .. } | Pass::Rounds { .. } | Pass::Raster { .. } => None,
        });
        let light = lit.zip(program.plan.light.as_ref());
        let light = light.map(|(draw, buffer)| compiler.raster(draw, &buffer.targets)).transpose()?;
        let fill = program.plan.fill.as_ref().map(|fill| compiler.compute(fill.kernel)).transpose()?;
        let plant = program.plan.plant.map(|plant| compiler.compute(plant.kernel)).transpose()?;
        let doubt = program.plan.plant.map(|plant| compiler.compute(plant.doubt)).transpose()?;
        let rank = program.plan.plant.map(|plant| compiler.compute(plant.rank)).transpose()?;
        let survey = program.plan.survey.map(|kernel| compiler.compute(kernel)).transpose()?;
        let drawn = program.plan.plant.map(|plant| compiler.compute(plant.drawn)).transpose()?;
        let sort = match program.plan.sort() {
            Some(sort) => Some(SortSteps {
                count: compiler.compute(sort.count)?,
                scan: compiler.compute(sort.scan)?,
                scatter: compiler.compute(sort.scatter)?,
            }),
            None => None,
        };
        let lists = match program.plan.footprints.map(|f| f.lists) {
            Some(lists) => Some(ListSteps {
                sums: compiler.compute(lists.sums)?,
                starts: compiler.compute(lists.starts)?,
                spread: compiler.compute(lists.spread)?,
                fill: compiler.compute(lists.fill)?,
            }),
            None => None,
        };
        if let Some(cache) = &gpu.cache {
            cache.save();
        }
        Ok(Self { passes, light, fill, plant, doubt, rank, survey, drawn, sort, lists })
    }
}

/// Compiled pipelines in the user's cache folder. Every failure of the file system turns it off and nothing else.
#[derive(Debug)]
pub(super) struct CacheFile {
    pub(super) cache: wgpu::PipelineCache,
    path: PathBuf,
    loaded: u64,
}

const MAGIC: &[u8; 8] = b"tyndall1";

impl CacheFile {
    /// The file of this adapter; `None` when there is no folder for it.
    #[expect(unsafe_code, reason = "wgpu takes the driver's own data back on trust; the checksum vouches for it")]
    pub(super) fn open(device: &wgpu::Device, info: &wgpu::AdapterInfo) -> Option<Self> {
        let folder = cache_folder()?;
        // Vendor and device alone would let two versions of a driver overwrite each other's file.
        let version = checksum(format!("{} {}", info.driver, info.driver_info).as_bytes());
        let path = folder.join(format!("{}_{version:016x}", wgpu::util::pipeline_cache_key(info)?));
        let data = fs::read(&path).ok().and_then(|file| unwrap(&file).map(<[u8]>::to_vec));
        let loaded = data.as_deref().map_or(0, checksum);
        // SAFETY: the data, if any, came from `get_data` of a cache of this adapter and driver: `unwrap` checks the
        // file's checksum, and the name of the file has the adapter and the driver's version. The driver checks its own
        // header besides, and `fallback` starts afresh when it does not like it.
        let cache = unsafe {
            device.create_pipeline_cache(&wgpu::PipelineCacheDescriptor {
                label: Some("tyndall"),
                data: data.as_deref(),
                fallback: true,
            })
        };
        Some(Self { cache, path, loaded })
    }

    /// Writes the file if there is anything new.
    fn save(&self) {
        let Some(data) = self.cache.get_data() else { return };
        if checksum(&data) == self.loaded {
            return;
        }
        // Written beside and renamed, so that another process never reads half a file.
        let scratch = self.path.with_extension(format!("{}.tmp", std::process::id()));
        let written = fs::write(&scratch, wrap(&data)).and_then(|()| fs::rename(&scratch, &self.path));
        if written.is_err() {
            let _ = fs::remove_file(&scratch);
        }
    }
}

/// Where pipelines are kept: `tyndall` in the user's cache folder, made if need be; `None` when it cannot be made.
#[must_use]
pub fn cache_folder() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let base = set("XDG_CACHE_HOME").filter(|p| p.is_absolute()).or_else(|| {
        if cfg!(target_os = "windows") {
            set("LOCALAPPDATA")
        } else if cfg!(target_os = "macos") {
            set("HOME").map(|h| h.join("Library/Caches"))
        } else {
            set("HOME").map(|h| h.join(".cache"))
        }
    })?;
    let folder = base.join("tyndall");
    fs::create_dir_all(&folder).ok()?;
    writable(&folder).then_some(folder)
}

fn writable(folder: &Path) -> bool {
    let probe = folder.join(format!(".{}.probe", std::process::id()));
    let ok = fs::write(&probe, b"").is_ok();
    let _ = fs::remove_file(&probe);
    ok
}

fn wrap(data: &[u8]) -> Vec<u8> {
    [MAGIC.as_slice(), &checksum(data).to_le_bytes(), data].concat()
}

fn unwrap(file: &[u8]) -> Option<&[u8]> {
    let rest = file.strip_prefix(MAGIC)?;
    let (sum, data) = rest.split_first_chunk::<8>()?;
    (checksum(data) == u64::from_le_bytes(*sum)).then_some(data)
}

/// FNV-1a: against accidents, not against malice (who may write the user's cache folder may do anything).
fn checksum(data: &[u8]) -> u64 {
    data.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damaged_cache_files_are_ignored() {
        let file = wrap(b"pipelines");
        assert_eq!(unwrap(&file), Some(b"pipelines".as_slice()));
        for at in 0..file.len() {
            let mut bad = file.clone();
            bad[at] ^= 1;
            assert_eq!(unwrap(&bad), None, "byte {at}");
            assert_eq!(unwrap(&file[..at]), None, "first {at} bytes");
        }
    }
}
