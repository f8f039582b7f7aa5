//! Shader modules, layouts and pipelines, and the file that keeps compiled pipelines from run to run.

use super::adapter::Gpu;
use super::errors::{GpuError, GpuErrorKind};
use compiler::loader::Scalar;
use compiler::program::kernel::Prim;
use compiler::program::{Binding, Program, texture_prim};
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

fn binding_type(program: &Program, binding: Binding) -> wgpu::BindingType {
    let storage = |read_only| wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    match binding {
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
        Binding::Table(_) | Binding::Mesh(_) | Binding::Rays => storage(true),
        Binding::Cache | Binding::Records => storage(false),
    }
}

/// The compiled passes and the layout of group 0, which all of them share.
#[derive(Debug)]
pub(super) struct Pipelines {
    pub(super) layout: wgpu::BindGroupLayout,
    /// One per kernel of the program.
    pub(super) kernels: Vec<wgpu::ComputePipeline>,
}

impl Pipelines {
    /// Compiles every kernel. `shaders[i]` is kernel `i`, validated already.
    pub(super) fn new(gpu: &Gpu, program: &Program, shaders: Vec<naga::Module>) -> Result<Self, GpuError> {
        if shaders.len() != program.kernels.len() {
            let message = format!("{} shaders for {} kernels", shaders.len(), program.kernels.len());
            return Err(GpuError::new(GpuErrorKind::Validation, message));
        }
        let entries: Vec<_> = (0..)
            .zip(&program.plan.bindings)
            .map(|(binding, b)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: binding_type(program, *b),
                count: None,
            })
            .collect();
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("plan"), entries: &entries });
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("plan"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        gpu.watch.check()?;
        let mut kernels = vec![];
        for (kernel, shader) in program.kernels.iter().zip(shaders) {
            let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(&kernel.name),
                source: wgpu::ShaderSource::Naga(Cow::Owned(shader)),
            });
            gpu.watch.check()?;
            gpu.created.fetch_add(1, Ordering::Relaxed);
            kernels.push(gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(&kernel.name),
                layout: Some(&pipeline_layout),
                module: &module,
                // A module has one entry point; its name is emit's affair.
                entry_point: None,
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: gpu.cache.as_ref().map(|c| &c.cache),
            }));
            gpu.watch.check()?;
        }
        if let Some(cache) = &gpu.cache {
            cache.save();
        }
        Ok(Self { layout, kernels })
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
