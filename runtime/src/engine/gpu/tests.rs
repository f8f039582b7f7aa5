//! The engine on hand-written kernels.

use super::*;
use crate::frame::{Eye, Frame};
use compiler::ir::{
    Aa, Backend, Bands, BandsKind, Camera, Composite, FieldScene, Filter, Graph, GridId, GridInfo, ImageInfo,
    Projection, RenderInfo, Scattering, Table, TableId, Tonemap, Type, Units,
};
use compiler::loader::{GridHeader, Scalar};
use compiler::program::kernel::{Expr, Function, Kernel, Prim, Resource, ResourceKind, Stage, Stmt, Ty};
use compiler::program::{
    Binding, Extent, FrameValue, Ledger, Output, OutputKind, Pass, Plan, Program, RaySource, StepRule, UniformField,
    UniformLayout, UniformSource,
};
use std::sync::Arc;

/// An adapter, or `None` with a line that says so. With `TYNDALL_REQUIRE_GPU=1` its absence is a failure.
fn open(needs: &Needs) -> Option<Arc<Gpu>> {
    match Gpu::new(&AdapterChoice::from_env(), needs) {
        Ok(gpu) => Some(Arc::new(gpu)),
        Err(error) if error.kind == GpuErrorKind::NoAdapter => {
            crate::engine::skip_without_adapter();
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn wgsl(text: &str) -> naga::Module {
    naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{}", e.emit_to_string(text)))
}

fn scene(graph: Graph) -> FieldScene {
    let mut graph = graph;
    let zero = graph.vector(&[0.0; 3]);
    let one = graph.scalar(1.0);
    FieldScene {
        units: Units::METRE,
        bands: Bands { kind: BandsKind::Gray, wavelengths: vec![550e-9] },
        params: vec![],
        media: vec![],
        lights: vec![],
        surfaces: vec![],
        meshes: vec![],
        splats: vec![],
        environment: false,
        background: one,
        shells: vec![],
        camera: Camera { from: zero, to: zero, up: zero, projection: Projection::Panorama },
        image: ImageInfo { size: [1, 1], aa: Aa::None, exposure: one, tonemap: Tonemap::None },
        render: RenderInfo {
            backend: Backend::Auto,
            scattering: Scattering::None,
            composite: Composite::Radiance,
            accuracy: 1e-2,
            steps: None,
            slices: None,
            stacks: compiler::ir::Stacks::View,
            pixels: compiler::ir::Pixels::Every,
            splats: None,
            samples: None,
            max_work: 1,
        },
        graph,
    }
}

fn program(
    graph: Graph,
    rays: RaySource,
    stride: u32,
    bindings: Vec<Binding>,
    fields: Vec<UniformField>,
) -> Arc<Program> {
    let size = fields.iter().map(|f| f.offset + 4 * u32::from(f.width)).max().unwrap_or(0).next_multiple_of(16);
    let scene = scene(graph);
    let extent = if rays == RaySource::Camera { Extent::Tile } else { Extent::Rays };
    let stage = Stage::Compute(if rays == RaySource::Camera { [8, 8, 1] } else { [64, 1, 1] });
    // The module says what is done with them; this only that they are used.
    let buffers: Vec<bool> = bindings.iter().map(|b| !matches!(b, Binding::Uniforms | Binding::Grid(_))).collect();
    let resource = |buffer: &bool| Resource {
        name: String::new(),
        kind: if *buffer { ResourceKind::WriteBuffer(Ty::F32) } else { ResourceKind::Texture3d(Prim::F32) },
    };
    let resources = buffers.iter().map(resource).collect();
    let store = |buffer| Stmt::Store { buffer, index: Expr::U32(0), value: Expr::F32(0.0) };
    let body = (0..).zip(&buffers).filter(|(_, buffer)| **buffer).map(|(number, _)| store(number)).collect();
    Arc::new(Program::new(
        (scene.clone(), scene),
        vec![Kernel {
            name: "main".into(),
            stage,
            structs: vec![],
            resources,
            functions: vec![],
            entry: Function { body, ..Function::default() },
        }],
        Plan {
            backend: "test",
            rays,
            outputs: vec![Output { kind: OutputKind::Radiance, offset: 0, width: stride as u8 }],
            stride,
            bindings,
            uniforms: UniformLayout { fields, size },
            passes: vec![Pass::Compute { kernel: 0, extent }],
            targets: vec![],
            light: None,
            notes: 0,
            repeats: 1,
            steps: StepRule::Closed,
            fill: None,
            plant: None,
            footprints: None,
            carried: 0,
            bounds: vec![],
            survey: None,
            samples: 1,
            work_per_ray: 1,
        },
        Ledger::default(),
    ))
}

fn field(name: &str, offset: u32, width: u8, integer: bool, source: UniformSource) -> UniformField {
    UniformField { name: name.into(), offset, width, integer, source }
}

pub(super) fn frame(size: [u32; 2], params: Vec<Vec<f64>>) -> Frame {
    let eye = Eye { anchor: [1.0, 2.0, 3.0], forward: [0.0, 0.0, 1.0], right: [4.0; 3], up: [5.0; 3], plane: 6.0 };
    Frame {
        params,
        time: 0.0,
        size,
        accuracy: 1e-3,
        white: 0.5,
        steps: 7,
        max_work: 9,
        eye,
        paths: 0,
        first_path: 0,
        seed: 0,
        bounds: None,
        grids: vec![],
        slabs: crate::frame::Slabs::default(),
        lattice: crate::frame::Lattice::default(),
        lean: 0.0,
        goes_on: false,
        footprints: Arc::default(),
        bricks: Arc::default(),
        columns: None,
        part: 0,
    }
}

/// Draws into one picture of records.
fn picture(prepared: &mut Prepared, frame: &Frame, stride: usize) -> (Vec<f32>, Timing) {
    let [width, height] = frame.size.map(|n| n as usize);
    let mut all = vec![f32::NAN; width * height * stride];
    let timing = prepared
        .draw(frame, &mut |tile, records| {
            let [x, y] = tile.origin.map(|n| n as usize);
            let row = tile.size[0] as usize * stride;
            assert_eq!(records.len(), row * tile.size[1] as usize);
            for (j, records) in records.chunks(row).enumerate() {
                let at = ((y + j) * width + x) * stride;
                all[at..at + row].copy_from_slice(records);
            }
        })
        .expect("draws");
    (all, timing)
}

const INDICES: &str = "
struct U { origin: vec2<u32>, size: vec2<u32>, image: vec2<u32>, level: f32, steps: u32, anchor: vec3<f32>, plane: f32 }
@group(0) @binding(0) var<uniform> u: U;
@group(0) @binding(1) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(8, 8) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= u.size.x || id.y >= u.size.y) { return; }
    let record = (id.y * u.size.x + id.x) * 4u;
    out[record] = f32(u.origin.x + id.x);
    out[record + 1u] = f32(u.origin.y + id.y);
    out[record + 2u] = u.level;
    out[record + 3u] = f32(u.image.x) + 1000.0 * f32(u.steps) + u.anchor.z + u.plane;
}";

fn indices() -> Arc<Program> {
    let mut graph = Graph::default();
    graph.params.push(Type::SCALAR);
    let param = graph.param(compiler::ir::ParamId(0));
    let three = graph.scalar(3.0);
    let level = graph.mul(param, three);
    let value = |v| UniformSource::Frame(v);
    let fields = vec![
        field("origin", 0, 2, true, value(FrameValue::TileOrigin)),
        field("size", 8, 2, true, value(FrameValue::TileSize)),
        field("image", 16, 2, true, value(FrameValue::ImageSize)),
        field("level", 24, 1, false, UniformSource::Node(level)),
        field("steps", 28, 1, true, value(FrameValue::Steps)),
        field("anchor", 32, 3, false, value(FrameValue::CameraAnchor)),
        field("plane", 44, 1, false, value(FrameValue::CameraPlane)),
    ];
    program(graph, RaySource::Camera, 4, vec![Binding::Uniforms, Binding::Records], fields)
}

#[test]
fn every_pixel_is_drawn_once_and_params_do_not_compile() {
    let program = indices();
    let Some(gpu) = open(&Needs::of(&program)) else { return };
    let mut prepared = gpu.prepare_modules(&program, vec![wgsl(INDICES)], SceneData::default()).expect("prepares");
    assert_eq!(gpu.pipelines_created(), 1);
    for (size, level) in [([1, 1], 0.5), ([640, 77], 2.0), ([16384, 1], 3.0), ([3, 2000], 4.0), ([0, 4], 1.0)] {
        let (records, timing) = picture(&mut prepared, &frame(size, vec![vec![level]]), 4);
        for (i, record) in records.chunks(4).enumerate() {
            let [x, y] = [i as u32 % size[0], i as u32 / size[0]].map(|n| n as f32);
            let last = size[0] as f32 + 7000.0 + 3.0 + 6.0;
            assert_eq!(record, [x, y, 3.0 * level as f32, last], "pixel {i} of {size:?}");
        }
        assert!(timing.milliseconds >= 0.0 && (timing.dispatches > 0) != size.contains(&0));
    }
    assert_eq!(gpu.pipelines_created(), 1, "a parameter compiled something");
}

#[test]
fn a_large_picture_is_cut_into_tiles() {
    let program = indices();
    let Some(gpu) = open(&Needs::of(&program)) else { return };
    let mut prepared = gpu.prepare_modules(&program, vec![wgsl(INDICES)], SceneData::default()).expect("prepares");
    let size = [1999, 2003];
    let mut seen = 0;
    let timing = prepared
        .draw(&frame(size, vec![vec![1.0]]), &mut |tile, records| {
            assert!(records.len() * 4 <= 32 << 20);
            assert_eq!(records[..2], tile.origin.map(|n| n as f32));
            let last = &records[records.len() - 4..];
            assert_eq!(last[0] as u32, tile.origin[0] + tile.size[0] - 1);
            assert_eq!(last[1] as u32, tile.origin[1] + tile.size[1] - 1);
            seen += records.len() / 4;
        })
        .expect("draws");
    assert_eq!(seen, 1999 * 2003);
    assert!(timing.dispatches >= 16, "{timing:?}");
}

#[test]
fn only_what_is_used_is_requested() {
    let program = indices();
    let needs = Needs::of(&program);
    assert_eq!((needs.textures, needs.storage_buffers, needs.invocations, needs.bindings), (0, 1, 64, 2));
    let Some(gpu) = open(&needs) else { return };
    let extra = gpu.features() - (wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::PIPELINE_CACHE);
    assert!(extra.is_empty(), "{extra:?}");
    assert_eq!(gpu.limits().max_storage_buffers_per_shader_stage, 1);
    assert_eq!(gpu.limits().max_compute_invocations_per_workgroup, 64);
}

#[test]
fn rays_of_a_list_go_through_the_same_path() {
    let text = "
@group(0) @binding(0) var<uniform> count: vec4<u32>;
@group(0) @binding(1) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= count.x) { return; }
    out[2u * id.x] = rays[2u * id.x].x;
    out[2u * id.x + 1u] = rays[2u * id.x].w + rays[2u * id.x + 1u].y;
}";
    let fields = vec![field("count", 0, 1, true, UniformSource::Frame(FrameValue::RayCount))];
    let bindings = vec![Binding::Uniforms, Binding::Rays, Binding::Records];
    let program = program(Graph::default(), RaySource::List, 2, bindings, fields);
    let Some(gpu) = open(&Needs::of(&program)) else { return };
    let mut prepared = gpu.prepare_modules(&program, vec![wgsl(text)], SceneData::default()).expect("prepares");
    for count in [0, 1, 65, 100_000] {
        let rays: Vec<PackedRay> = (0..count).map(|i| [i as f32, 0., 0., -1., 0., i as f32 * 0.5, 0., 0.]).collect();
        let mut all = vec![];
        prepared
            .trace(&frame([0, 0], vec![]), &rays, &mut |_, records| all.extend_from_slice(records))
            .expect("traces");
        assert_eq!(all.len(), 2 * rays.len());
        for (i, record) in all.chunks(2).enumerate() {
            assert_eq!(record, [i as f32, i as f32 * 0.5 - 1.0], "ray {i}");
        }
    }
    let error = prepared.draw(&frame([2, 2], vec![]), &mut |_, _| {}).expect_err("has no camera");
    assert_eq!(error.kind, GpuErrorKind::Validation);
}

/// Reads every voxel of a grid back through a texture.
fn read_grid(scalar: Scalar, dims: [u32; 3], bytes: &[u8]) -> Option<Vec<f32>> {
    let header = GridHeader { dims, scalar, slope: 2.0, intercept: 1.0, world_from_index: [[0.0; 4]; 3] };
    let mut graph = Graph::default();
    graph.grids.push(GridInfo {
        name: "g".into(),
        span: None,
        path: String::new(),
        from: String::new(),
        header: header.clone(),
        filter: Filter::Nearest,
        outside: 0.0,
    });
    let ty = match compiler::program::texture_prim(scalar).0 {
        compiler::program::kernel::Prim::U32 => "u32",
        compiler::program::kernel::Prim::I32 => "i32",
        compiler::program::kernel::Prim::F32 => "f32",
        compiler::program::kernel::Prim::Bool => unreachable!("no grid of truth values"),
    };
    let text = format!(
        "struct U {{ origin: vec2<u32>, size: vec2<u32>, image: vec2<u32> }}
@group(0) @binding(0) var<uniform> u: U;
@group(0) @binding(1) var t: texture_3d<{ty}>;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(8, 8) fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
    if (id.x >= u.size.x || id.y >= u.size.y) {{ return; }}
    let at = u.origin + id.xy;
    let n = textureDimensions(t);
    out[id.y * u.size.x + id.x] = f32(textureLoad(t, vec3<i32>(vec3<u32>(at.x, at.y % n.y, at.y / n.y)), 0).x);
}}"
    );
    let value = |v| UniformSource::Frame(v);
    let fields = vec![
        field("origin", 0, 2, true, value(FrameValue::TileOrigin)),
        field("size", 8, 2, true, value(FrameValue::TileSize)),
        field("image", 16, 2, true, value(FrameValue::ImageSize)),
    ];
    let bindings = vec![Binding::Uniforms, Binding::Grid(GridId(0)), Binding::Records];
    let program = program(graph, RaySource::Camera, 1, bindings, fields);
    let gpu = open(&Needs::of(&program))?;
    let grids = [GridData { header: &header, bytes }];
    let mut prepared =
        gpu.prepare_modules(&program, vec![wgsl(&text)], SceneData { grids: &grids, meshes: &[] }).expect("prepares");
    Some(picture(&mut prepared, &frame([dims[0], dims[1] * dims[2]], vec![]), 1).0)
}

#[test]
fn grids_keep_their_stored_values() {
    // Odd widths, so that rows are not aligned.
    let dims = [5, 3, 7];
    let count = 105;
    macro_rules! check {
        ($scalar:expr, $t:ty, $value:expr) => {{
            let values: Vec<$t> = (0..count).map($value).collect();
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
            let Some(read) = read_grid($scalar, dims, &bytes) else { return };
            let expected: Vec<f32> = values.iter().map(|v| *v as f32).collect();
            assert_eq!(read, expected, "{:?}", $scalar);
        }};
    }
    check!(Scalar::U8, u8, |i: u32| (i * 3 % 256) as u8);
    check!(Scalar::I8, i8, |i: u32| (i as i32 - 60) as i8);
    check!(Scalar::U16, u16, |i: u32| (i * 601) as u16);
    check!(Scalar::I16, i16, |i: u32| (i as i32 * 300 - 16000) as i16);
    check!(Scalar::U32, u32, |i: u32| i * 40_000_000);
    check!(Scalar::I32, i32, |i: u32| i as i32 * 20_000_000 - 1_000_000_000);
    check!(Scalar::U64, u64, |i: u32| u64::from(i) << 40);
    check!(Scalar::I64, i64, |i: u32| (i64::from(i) - 50) << 40);
    check!(Scalar::F32, f32, |i: u32| i as f32 * 0.37 - 3.0);
    check!(Scalar::F64, f64, |i: u32| f64::from(i) * 0.37e-9);
}

#[test]
fn a_grid_larger_than_a_slab_arrives_whole() {
    // Slices of 15 MiB: each is cut into rows.
    let dims = [1999, 2000, 3];
    let count = dims.iter().product::<u32>() as usize;
    let values: Vec<f32> = (0..count).map(|i| (i % 16_777_213) as f32).collect();
    let Some(read) = read_grid(Scalar::F32, dims, bytemuck::cast_slice(&values)) else { return };
    let wrong = read.iter().zip(&values).position(|(a, b)| a != b);
    assert_eq!(wrong, None, "of {count}");
}

#[test]
fn a_grid_that_no_adapter_takes_is_an_error() {
    let needs = Needs { grid: Some((1 << 24, "huge".into())), ..Needs::default() };
    match Gpu::new(&AdapterChoice::from_env(), &needs).map(drop) {
        Err(error) if error.kind == GpuErrorKind::NoAdapter => crate::engine::skip_without_adapter(),
        Err(error) => {
            assert_eq!(error.kind, GpuErrorKind::TooLarge);
            assert!(error.message.contains("`huge` is 16777216 voxels long"), "{error}");
        }
        Ok(()) => panic!("an adapter takes 2^24 voxels"),
    }
}

#[test]
fn memory_that_is_full_is_an_error_and_what_was_there_goes_on() {
    let program = indices();
    let mut needs = Needs::of(&program);
    needs.grid = Some((2048, "huge".into()));
    let Some(gpu) = open(&needs) else { return };
    let mut prepared = gpu.prepare_modules(&program, vec![wgsl(INDICES)], SceneData::default()).expect("prepares");
    let frame = frame([8, 8], vec![vec![1.0]]);
    let (before, _) = picture(&mut prepared, &frame, 4);
    // Textures of 32 GiB each, into which nothing is written. No machine has room for 4 TiB of them.
    let mut held = vec![];
    let error = (0..128).find_map(|_| {
        held.push(gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("huge"),
            size: wgpu::Extent3d { width: 2048, height: 2048, depth_or_array_layers: 2048 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        }));
        gpu.watch.check().err()
    });
    let error = error.expect("memory is not endless");
    assert_eq!((error.kind, error.kind.code()), (GpuErrorKind::OutOfMemory, "E0633"), "{error}");
    assert!(error.hint.is_some());
    drop(held);
    assert_eq!(picture(&mut prepared, &frame, 4).0, before);
}

#[test]
fn an_unknown_adapter_is_named_with_those_there_are() {
    let choice = AdapterChoice { name: Some("no such thing".into()), ..AdapterChoice::default() };
    let error = Gpu::new(&choice, &Needs::default()).expect_err("no such adapter");
    assert_eq!(error.kind, GpuErrorKind::NoAdapter);
    assert!(error.hint.is_some());
}

#[test]
fn tables_follow_the_parameters() {
    let mut graph = Graph::default();
    graph.params.push(Type::SCALAR);
    let param = graph.param(compiler::ir::ParamId(0));
    let (zero, one, two) = (graph.scalar(0.0), graph.scalar(1.0), graph.scalar(2.0));
    let scaled = graph.mul(param, two);
    graph.add_table(Table {
        name: "t".into(),
        span: None,
        keys: vec![zero, one],
        values: vec![param, scaled],
        width: 1,
    });
    let text = "
@group(0) @binding(0) var<storage, read> t: array<f32>;
@group(0) @binding(1) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(8, 8) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x + id.y > 0u) { return; }
    for (var i = 0u; i < 4u; i++) { out[i] = t[i]; }
}";
    let bindings = vec![Binding::Table(TableId(0)), Binding::Records];
    let program = program(graph, RaySource::Camera, 4, bindings, vec![]);
    let Some(gpu) = open(&Needs::of(&program)) else { return };
    let mut prepared = gpu.prepare_modules(&program, vec![wgsl(text)], SceneData::default()).expect("prepares");
    for value in [1.5, 1e60, 2.5] {
        let (records, _) = picture(&mut prepared, &frame([1, 1], vec![vec![value]]), 4);
        let held = |x: f64| (x as f32).min(f32::MAX);
        assert_eq!(records, [0.0, held(value), 1.0, held(2.0 * value)]);
    }
    assert_eq!(gpu.pipelines_created(), 1);
}

#[test]
fn a_lost_device_is_an_error_and_stays_one() {
    let program = indices();
    let Some(gpu) = open(&Needs::of(&program)) else { return };
    let mut prepared = gpu.prepare_modules(&program, vec![wgsl(INDICES)], SceneData::default()).expect("prepares");
    let frame = frame([64, 64], vec![vec![1.0]]);
    picture(&mut prepared, &frame, 4);
    gpu.device.destroy();
    for _ in 0..2 {
        let error = prepared.draw(&frame, &mut |_, _| {}).expect_err("the device is gone");
        assert_eq!(error.kind, GpuErrorKind::DeviceLost, "{error}");
        assert!(error.hint.is_some());
    }
    let error =
        gpu.prepare_modules(&program, vec![wgsl(INDICES)], SceneData::default()).expect_err("the device is gone");
    assert_eq!(error.kind, GpuErrorKind::DeviceLost, "{error}");
}

#[test]
fn a_shader_that_does_not_fit_the_plan_is_an_error() {
    let program = indices();
    let Some(gpu) = open(&Needs::of(&program)) else { return };
    let text = INDICES.replace("@binding(1)", "@binding(5)");
    let error = gpu
        .prepare_modules(&program, vec![wgsl(&text)], SceneData::default())
        .expect_err("binding 5 is not in the plan");
    assert_eq!(error.kind, GpuErrorKind::Validation);
    assert!(!error.message.contains('\n'), "{error}");
    let error = gpu.prepare_modules(&program, vec![], SceneData::default()).expect_err("a shader is missing");
    assert_eq!(error.kind, GpuErrorKind::Validation);
}
