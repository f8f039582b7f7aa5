//! Grids as textures and tables as buffers.

use super::adapter::Gpu;
use super::errors::GpuError;
use super::pipelines::texture_format;
use super::sorting::Sorting;
use super::uniforms::table_rows;
use crate::frame::{Bricks, Slabs, Turn, to_f32};
use compiler::ir::eval::Tables;
use compiler::ir::{GridId, MeshId, TableId};
use compiler::loader::{GridHeader, Scalar};
use compiler::program::{Binding, MOST_BRICKS, Program};
use std::collections::HashMap;

/// Voxels in memory: x fastest, in the machine's byte order, as many as the header says.
#[derive(Copy, Clone, Debug)]
pub struct GridData<'a> {
    /// Size and type.
    pub header: &'a GridHeader,
    /// The stored samples.
    pub bytes: &'a [u8],
}

/// What a program reads besides its uniforms.
#[derive(Copy, Clone, Debug, Default)]
pub struct SceneData<'a> {
    /// Element `i` is grid `i` of the program's graph.
    pub grids: &'a [GridData<'a>],
    /// Element `i` is mesh `i` of the scene, as [`Binding::Mesh`] says.
    pub meshes: &'a [Vec<f32>],
}

/// What has been uploaded once and is read by every part of a program: grids and meshes by their number.
#[derive(Debug, Default)]
pub(super) struct Uploads {
    grids: HashMap<GridId, wgpu::TextureView>,
    meshes: HashMap<MeshId, wgpu::Buffer>,
}

/// Bytes that are handed to wgpu at once. It keeps a copy until the upload is done, so this bounds that copy.
const SLAB: usize = 8 << 20;

/// What the bindings of a plan name, but for what each dispatch has of its own.
#[derive(Debug)]
pub(super) struct Resources {
    /// Views of grids, in the order of the bindings that name them.
    pub(super) grids: Vec<wgpu::TextureView>,
    /// Tables likewise.
    pub(super) tables: Vec<(TableId, wgpu::Buffer, Vec<f32>)>,
    /// Meshes likewise.
    pub(super) meshes: Vec<wgpu::Buffer>,
    /// Bounds likewise, with their numbers in the plan.
    pub(super) bounds: Vec<(u32, wgpu::Buffer)>,
    /// Columns of light.
    pub(super) cache: Option<wgpu::Buffer>,
    /// Outlines of slabs, and how many corners there are.
    pub(super) outlines: Option<(wgpu::Buffer, u32)>,
    /// Where light meets slabs one after another: the corners of each, and the nodes of its buffer.
    pub(super) turns: (Vec<Turn>, [u32; 2]),
    /// What puts splats in order.
    pub(super) sorting: Option<Sorting>,
    /// How many of them are drawn.
    pub(super) drawn: u32,
    /// Their coefficients.
    pub(super) splats: Option<wgpu::Buffer>,
    /// What tells pixels apart.
    pub(super) survey: Option<wgpu::Buffer>,
    /// Splats of files as the picture shows them, and how many numbers they have.
    pub(super) footprints: Option<(wgpu::Buffer, u32)>,
}

impl Resources {
    pub(super) fn new(
        gpu: &Gpu,
        program: &Program,
        data: SceneData<'_>,
        uploads: &mut Uploads,
    ) -> Result<Self, GpuError> {
        let mut resources = Self {
            grids: vec![],
            tables: vec![],
            meshes: vec![],
            bounds: vec![],
            cache: None,
            outlines: None,
            turns: (vec![], [1; 2]),
            sorting: None,
            drawn: 0,
            splats: None,
            survey: None,
            footprints: None,
        };
        for binding in &program.plan.bindings {
            match binding {
                Binding::Grid(id) => {
                    if !uploads.grids.contains_key(id) {
                        let name = &program.optimised.graph.grid(*id).name;
                        uploads.grids.insert(*id, upload(gpu, name, data.grids[id.0 as usize])?);
                    }
                    resources.grids.extend(uploads.grids.get(id).cloned());
                }
                Binding::Table(id) => {
                    let table = program.optimised.graph.table(*id);
                    let size = table.keys.len() as u64 * (u64::from(table.width) + 1) * 4;
                    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                        label: Some(&table.name),
                        size,
                        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                        mapped_at_creation: false,
                    });
                    resources.tables.push((*id, buffer, vec![]));
                }
                Binding::Mesh(id) => {
                    let buffer = uploads.meshes.entry(*id).or_insert_with(|| {
                        let numbers: &[u8] = bytemuck::cast_slice(&data.meshes[id.0 as usize]);
                        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                            label: Some(&program.optimised.meshes[id.0 as usize].path),
                            size: numbers.len() as u64,
                            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                            mapped_at_creation: false,
                        });
                        gpu.queue.write_buffer(&buffer, 0, numbers);
                        buffer
                    });
                    resources.meshes.push(buffer.clone());
                }
                Binding::Bounds(number) => {
                    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                        label: Some("bounds"),
                        size: u64::from(MOST_BRICKS) * 16,
                        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                        mapped_at_creation: false,
                    });
                    resources.bounds.push((*number, buffer));
                }
                Binding::Cache => {
                    let size = 4 * program.plan.fill.as_ref().map_or(1, |f| u64::from(f.floats)).max(1);
                    resources.cache = Some(gpu.device.create_buffer(&wgpu::BufferDescriptor {
                        label: Some("columns of light"),
                        size,
                        usage: wgpu::BufferUsages::STORAGE,
                        mapped_at_creation: false,
                    }));
                }
                // They come with each drawing.
                Binding::Outlines | Binding::Order | Binding::Splats | Binding::SplatsRead | Binding::Target(_) => {}
                Binding::Footprints | Binding::TileLists | Binding::Carried | Binding::Survey | Binding::Light(_) => {}
                Binding::Keys | Binding::KeysRead | Binding::Sorting(_) | Binding::Tallies => {}
                Binding::Workgroup(_) | Binding::Reaches | Binding::Starts | Binding::StartsRead => {}
                Binding::Entries | Binding::EntriesRead | Binding::TileListsWritten => {}
                Binding::Uniforms | Binding::Rays | Binding::Records | Binding::Notes | Binding::NotesRead => {}
            }
        }
        gpu.watch.check()?;
        Ok(resources)
    }

    /// Writes the outlines of slabs. Gives whether the buffer is another one now.
    pub(super) fn write_outlines(&mut self, gpu: &Gpu, slabs: &Slabs) -> bool {
        let corners = slabs.outlines.as_slice();
        self.turns = (slabs.turns.clone(), slabs.light.counts);
        write(gpu, "outlines", &mut self.outlines, bytemuck::cast_slice(corners), corners.len())
    }

    /// Makes room for so many splats. Gives whether the buffer is another one now.
    pub(super) fn hold_splats(&mut self, gpu: &Gpu, count: u32, stride: u32) -> bool {
        hold(gpu, "splats", &mut self.splats, u64::from(count) * u64::from(stride) * 4)
    }

    /// Makes room for a survey of so many pixels. Gives whether the buffer is another one now.
    pub(super) fn hold_survey(&mut self, gpu: &Gpu, pixels: u32) -> bool {
        hold(gpu, "survey", &mut self.survey, u64::from(pixels) * 4)
    }

    /// Writes splats of files. Gives whether the buffer is another one now.
    pub(super) fn write_footprints(&mut self, gpu: &Gpu, records: &[f32]) -> bool {
        write(gpu, "footprints", &mut self.footprints, bytemuck::cast_slice(records), records.len())
    }

    /// Writes the bounds of media.
    pub(super) fn write_bounds(&self, gpu: &Gpu, bricks: &[Bricks]) {
        for (number, buffer) in &self.bounds {
            if let Some(bricks) = bricks.get(*number as usize) {
                gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(bricks.records()));
            }
        }
    }

    /// Writes the tables whose contents changed since the last drawing.
    pub(super) fn write_tables(&mut self, gpu: &Gpu, tables: &Tables) {
        for (id, buffer, last) in &mut self.tables {
            let rows = table_rows(tables, *id);
            // By bits: a NaN equals itself here.
            if bytemuck::cast_slice::<f32, u8>(&rows) != bytemuck::cast_slice::<f32, u8>(last) {
                gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&rows));
                *last = rows;
            }
        }
    }
}

/// A storage buffer of at least so many bytes.
pub(super) fn storage(gpu: &Gpu, label: &str, bytes: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes.next_power_of_two().max(64),
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}

/// Makes another buffer where there is none that holds so many bytes, and says so.
fn hold(gpu: &Gpu, label: &str, slot: &mut Option<wgpu::Buffer>, bytes: u64) -> bool {
    let fits = matches!(slot, Some(buffer) if buffer.size() >= bytes);
    if !fits {
        *slot = Some(storage(gpu, label, bytes));
    }
    !fits
}

/// Writes a buffer and how many things are in it; makes another where it is too small, and says so.
fn write(gpu: &Gpu, label: &str, slot: &mut Option<(wgpu::Buffer, u32)>, bytes: &[u8], count: usize) -> bool {
    let fits = matches!(slot, Some((buffer, _)) if buffer.size() >= bytes.len() as u64);
    if !fits {
        *slot = Some((storage(gpu, label, bytes.len() as u64), 0));
    }
    if let Some((buffer, held)) = slot {
        gpu.queue.write_buffer(buffer, 0, bytes);
        *held = count as u32;
    }
    !fits
}

/// Converts 64-bit samples; everything else is uploaded as it lies in memory.
fn convert(scalar: Scalar, bytes: &[u8]) -> Option<Vec<f32>> {
    let eight = |f: fn([u8; 8]) -> f64| bytes.as_chunks::<8>().0.iter().map(|b| to_f32(f(*b))).collect();
    match scalar {
        Scalar::U64 => Some(eight(|b| u64::from_ne_bytes(b) as f64)),
        Scalar::I64 => Some(eight(|b| i64::from_ne_bytes(b) as f64)),
        Scalar::F64 => Some(eight(f64::from_ne_bytes)),
        Scalar::U8 | Scalar::I8 | Scalar::U16 | Scalar::I16 | Scalar::U32 | Scalar::I32 | Scalar::F32 => None,
    }
}

fn upload(gpu: &Gpu, name: &str, grid: GridData<'_>) -> Result<wgpu::TextureView, GpuError> {
    let [width, height, depth] = grid.header.dims;
    let scalar = grid.header.scalar;
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(name),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: depth },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: texture_format(scalar),
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.watch.check()?;
    let row = width as usize * scalar.bytes();
    let texel_row = width * scalar.bytes().min(4) as u32;
    // Whole slices where several fit into a slab, else rows of one slice.
    let rows = (SLAB / row.max(1)).clamp(1, height as usize) as u32;
    let slices = if rows < height { 1 } else { (SLAB / (row * height as usize)).clamp(1, depth as usize) as u32 };
    for z in (0..depth).step_by(slices as usize) {
        for y in (0..height).step_by(rows as usize) {
            let (rows, slices) = (rows.min(height - y), slices.min(depth - z));
            let first = (z as usize * height as usize + y as usize) * row;
            let samples = &grid.bytes[first..first + row * rows as usize * slices as usize];
            let converted = convert(scalar, samples);
            let data = converted.as_ref().map_or(samples, |c| bytemuck::cast_slice(c));
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x: 0, y, z },
                    aspect: wgpu::TextureAspect::All,
                },
                data,
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(texel_row), rows_per_image: Some(rows) },
                wgpu::Extent3d { width, height: rows, depth_or_array_layers: slices },
            );
            // Wait for it, or wgpu would hold a copy of the whole grid.
            let index = gpu.queue.submit([]);
            gpu.watch.wait(index)?;
        }
    }
    Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
}
