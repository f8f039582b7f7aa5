//! Intervals against values: no coefficient of any scene, and no function of the library, leaves its interval over a region.

use compiler::analysis::interval::{Enclosure, Interval, Region, TableBounds, altitudes};
use compiler::ir::eval::{Environment, LANES, Tables, Tape, evaluate_with};
use compiler::ir::{FieldScene, NodeId};
use compiler::{Options, compile};
use runtime::frame::{FileLoader, Grids, Params, SceneFiles};
use std::path::Path;
use tyndall_tests::{files, name, text};

/// SplitMix64 (Steele, Lea and Flood 2014), as numbers from 0 to 1.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn within(&mut self, i: Interval) -> f64 {
        (i.low + i.width() * self.unit()).clamp(i.low, i.high)
    }
}

/// Every field of the media.
fn fields(scene: &FieldScene) -> Vec<NodeId> {
    let all = scene.media.iter().flat_map(|m| [Some(m.k_a), Some(m.k_s), Some(m.k_e), m.data, m.phase]);
    let mut all: Vec<NodeId> = all.flatten().collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// Compares values with intervals over regions of many sizes within `reach` of the origin, in units of the scene. How many
/// numbers were compared, and what is wrong.
fn check(scene: &FieldScene, grids: &Grids, reach: f64, rounds: usize, random: &mut Random) -> (usize, Vec<String>) {
    let graph = &scene.graph;
    let roots = fields(scene);
    let (code, tape) = (Enclosure::new(graph, &roots), Tape::new(graph, &roots));
    let (mut work, mut scratch) = (code.workspace(), tape.scratch());
    let params = Params::defaults(scene).0;
    let values = Tables::evaluate(graph, &params, 0.25);
    let shells: Vec<([f64; 3], f64)> = (scene.shells.iter())
        .map(|(center, inner)| {
            let v = evaluate_with(graph, &[*center, *inner], &params, 0.25, &values);
            (std::array::from_fn(|i| v[0][i.min(v[0].len() - 1)]), v[1][0])
        })
        .collect();
    // Some of the parameters range, others are known.
    let ranges: Vec<Vec<Interval>> = (scene.params.iter().zip(&params).enumerate())
        .map(|(i, (param, v))| match param.range.filter(|_| i % 2 == 0) {
            Some((low, high)) => {
                let scale = scene.units.scale(param.dimension[0]);
                vec![Interval::new(low * scale, high * scale); v.len()]
            }
            None => v.iter().map(|x| Interval::point(*x)).collect(),
        })
        .collect();
    let time = Interval::new(0.0, 0.5);
    let tables = TableBounds::new(graph, &ranges, time);
    let (mut count, mut wrong) = (0, vec![]);
    for round in 0..rounds {
        let size = reach * [1e-4, 1e-2, 0.1, 1.0][round % 4];
        let position = [0, 1, 2].map(|_| {
            let low = reach * (2.0 * random.unit() - 1.0);
            Interval::new(low, low + size * random.unit())
        });
        let above: Vec<Interval> = shells.iter().map(|(c, r)| altitudes(position, *c, *r)).collect();
        let region =
            Region { position, time, altitudes: &above, params: &ranges, tables: &tables, ..Region::default() };
        code.run(&region, grids, &mut work);
        for _ in 0..2 {
            let chosen: Vec<Vec<f64>> = ranges.iter().map(|v| v.iter().map(|i| random.within(*i)).collect()).collect();
            let now = random.within(time);
            let values = Tables::evaluate(graph, &chosen, now);
            let at = position.map(|i| std::array::from_fn(|_| random.within(i)));
            let heights: Vec<[f64; LANES]> = (shells.iter())
                .map(|(c, r)| {
                    std::array::from_fn(|l| (0..3).map(|i| (at[i][l] - c[i]).powi(2)).sum::<f64>().sqrt() - r)
                })
                .collect();
            let environment = Environment {
                position: at,
                direction: [[0.6; LANES], [0.0; LANES], [0.8; LANES]],
                cos_theta: std::array::from_fn(|_| 2.0 * random.unit() - 1.0),
                time: now,
                altitudes: &heights,
                params: &chosen,
                tables: &values,
            };
            tape.run(&environment, grids, &mut scratch);
            for i in 0..roots.len() {
                for (lanes, interval) in tape.root(&scratch, i).iter().zip(code.root(&work, i)) {
                    for (lane, value) in lanes.iter().enumerate() {
                        count += 1;
                        if !interval.holds(*value) {
                            wrong.push(format!("{value:e} at {:?} is not in {interval:?}", at.map(|p| p[lane])));
                        }
                    }
                }
            }
        }
    }
    wrong.truncate(3);
    (count, wrong)
}

#[test]
fn no_coefficient_of_a_scene_leaves_its_interval() {
    let mut random = Random(1);
    let folders = [
        "tests/suite",
        "tests/suite/agree",
        "tests/suite/light",
        "tests/suite/paths",
        "tests/suite/thin",
        "examples",
        "examples/paths",
    ];
    for path in folders.iter().flat_map(|f| files(f, "vol")) {
        let loader = FileLoader::new(path.parent().expect("a scene lies in a folder"));
        let compiled = compile(name(&path), &text(&path), &loader, &Options::default());
        let program = compiled.program.unwrap_or_else(|| panic!("{} compiles", path.display()));
        let volumes = loader.volumes(&program.lowered.graph.grids).unwrap_or_else(|e| panic!("{}", e.0.message));
        let grids = Grids::new(volumes);
        for scene in [&program.lowered, &program.optimised] {
            let reach = 4.0 * scene.units.scale(1.0);
            let (count, wrong) = check(scene, &grids, reach, 24, &mut random);
            assert!(wrong.is_empty(), "{}: {wrong:#?} of {count}", path.display());
        }
    }
}

/// Every kind of function of the library that makes fields, over `q` in metres.
const LIBRARY: [&str; 42] = [
    "value(q)",
    "value3(q).y",
    "perlin(q)",
    "perlin3(q).z",
    "fbm(q)",
    "fbm(q, octaves: 6, seed: 9)",
    "turbulence(q)",
    "ridged(q)",
    "worley(q)",
    "worley2(q)",
    "curl(q).x",
    "warp(q).y",
    "fbm(warp(q, amount: 0.6))",
    "viridis(q.x).g",
    "magma(q.x).r",
    "turbo(q.x).b",
    "coolwarm(q.y).g",
    "cividis(q.z).g",
    "hot(q.x).r",
    "black_body(1000 + 900 * q.x).g",
    "ramp(q.x, 2, 4)",
    "sd_sphere(p, 1 m) / 1 m",
    "sd_box(p, (0.5, 1, 0.7) m) / 1 m",
    "sd_round_box(p, (0.5, 1, 0.7) m, 0.1 m) / 1 m",
    "sd_torus(p, 1 m, 0.2 m) / 1 m",
    "sd_capsule(p, (0, 0, 0) m, (1, 1, 0) m, 0.2 m) / 1 m",
    "sd_cylinder(p, 1 m, 0.5 m) / 1 m",
    "sd_ellipsoid(p, (1, 0.5, 0.7) m) / 1 m",
    "sd_octahedron(p, 1 m) / 1 m",
    "op_shell(sd_sphere(p, 1 m), 0.1 m) / 1 m",
    "op_smooth_union(p.x, p.y, 0.2 m) / 1 m",
    "op_smooth_difference(p.x, p.z, 0.3 m) / 1 m",
    "length(op_repeat(p, (1, 1, 1) m)) / 1 m",
    "length(op_mirror_x(p)) / 1 m",
    "op_rotate_x(p, 30 deg).y / 1 m",
    "smoothstep(0.2, 0.9, q.x)",
    "exp(-(length(q) / 0.3)^2)",
    "sin(3 * q.x) * cos(q.y) + tanh(q.z)",
    "if length(q) < 1 then 2 else 0",
    "sqrt(abs(q.x)) + log(1 + q.y * q.y)",
    "clamp(1 - abs(length(q) - 0.8) / 0.0001, 0, 1)",
    "mod(q.x, 0.7) + atan2(q.y, q.x)",
];

#[test]
fn no_function_of_the_library_leaves_its_interval() {
    let mut random = Random(2);
    let mut total = 0;
    for expression in LIBRARY {
        let scene = format!(
            "use std::noise::{{value, value3, perlin, perlin3, fbm, turbulence, ridged, worley, worley2, curl, warp}}
             use std::color::{{viridis, magma, turbo, coolwarm, cividis, hot, black_body, ramp}}
             use std::shape::{{sd_sphere, sd_box, sd_round_box, sd_torus, sd_capsule, sd_cylinder, sd_ellipsoid, sd_octahedron}}
             use std::shape::{{op_shell, op_smooth_union, op_smooth_difference, op_repeat, op_mirror_x, op_rotate_x}}
             medium test {{
                 shape = sphere(center: (0, 0, 0) m, radius: 3 m)
                 k_a = {{ let q = p / 1 m  ({expression}) / 1 m }}
             }}"
        );
        let loader = FileLoader::new(Path::new("."));
        let compiled = compile("library", &scene, &loader, &Options::default());
        let program = compiled.program.unwrap_or_else(|| {
            panic!("{expression}: {}", compiler::diagnostic::render(&compiled.diagnostics, &compiled.sources))
        });
        let reach = 3.0 * program.lowered.units.scale(1.0);
        for scene in [&program.lowered, &program.optimised] {
            let (count, wrong) = check(scene, &Grids::default(), reach, 240, &mut random);
            assert!(wrong.is_empty(), "{expression}: {wrong:#?} of {count}");
            total += count;
        }
    }
    assert!(total > 300_000, "{total}");
}
