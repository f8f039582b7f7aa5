//! The tree and the rays through it.

use super::*;
use proptest::prelude::*;

/// Möller and Trumbore's test, written out on its own: t and how far inside the triangle the ray passes.
fn plain_hit(triangle: &Triangle, origin: [f64; 3], direction: [f64; 3]) -> Option<(f64, f64)> {
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let [a, b, c] = triangle.map(|p| p.map(f64::from));
    let (e1, e2, s) = (sub(b, a), sub(c, a), sub(origin, a));
    let p = cross(direction, e2);
    let det = dot(e1, p);
    let (q, u) = (cross(s, e1), dot(s, p) / det);
    let (v, t) = (dot(direction, q) / det, dot(e2, q) / det);
    (det != 0.0).then_some((t, u.min(v).min(1.0 - u - v)))
}

/// The least t of all triangles, and whether no triangle's edge is so near that rounding could decide.
fn brute_force(mesh: &Mesh, origin: [f64; 3], direction: [f64; 3], range: (f64, f64)) -> (Option<f64>, bool) {
    let (mut nearest, mut clear) = (None, true);
    for (t, inside) in mesh.triangles().iter().filter_map(|t| plain_hit(t, origin, direction)) {
        clear &= inside.abs() > 1e-7 && (t - range.0).abs() > 1e-9 && (t - range.1).abs() > 1e-9;
        if inside >= 0.0 && range.0 <= t && t <= range.1 && nearest.is_none_or(|n| t < n) {
            nearest = Some(t);
        }
    }
    (nearest, clear)
}

/// What must hold of any tree. Returns its depth.
fn check_tree(mesh: &Mesh) -> usize {
    fn walk(mesh: &Mesh, at: usize, next: &mut u32) -> usize {
        let node = mesh.nodes()[at];
        let inside = |min: [f32; 3], max: [f32; 3]| {
            (0..3).all(|i| node.min[i] <= min[i] && min[i] <= max[i] && max[i] <= node.max[i])
        };
        if node.count > 0 {
            assert!(node.count as usize <= bvh::LEAF && node.first == *next && node.skip as usize == at + 1);
            *next += node.count;
            for triangle in &mesh.triangles()[node.first as usize..*next as usize] {
                assert!(triangle.iter().all(|corner| inside(*corner, *corner)));
            }
            return 1;
        }
        let left = at + 1;
        let right = mesh.nodes()[left].skip as usize;
        assert!(left < right && right < node.skip as usize);
        assert_eq!(mesh.nodes()[right].skip, node.skip);
        for child in [left, right] {
            assert!(inside(mesh.nodes()[child].min, mesh.nodes()[child].max));
        }
        1 + walk(mesh, left, next).max(walk(mesh, right, next))
    }
    let mut next = 0;
    let depth = walk(mesh, 0, &mut next);
    assert_eq!(next as usize, mesh.triangles().len(), "every triangle is in one leaf");
    assert_eq!(mesh.nodes()[0].skip as usize, mesh.node_count());
    depth
}

/// A walk through the packed form in f32, as a shader does it.
fn packed_nearest(words: &[f32], nodes: usize, origin: [f32; 3], direction: [f32; 3]) -> Option<f32> {
    let mut nearest: Option<f32> = None;
    let mut at = 0;
    while at < nodes {
        let node = &words[8 * at..8 * at + 8];
        let (mut low, mut high) = (0.0_f32, nearest.unwrap_or(f32::INFINITY));
        for i in 0..3 {
            let (a, b) = ((node[i] - origin[i]) / direction[i], (node[4 + i] - origin[i]) / direction[i]);
            low = low.max(a.min(b));
            high = high.min(a.max(b));
        }
        if low > high {
            at = node[3].to_bits() as usize;
            continue;
        }
        let leaf = node[7].to_bits();
        for i in leaf >> 3..(leaf >> 3) + (leaf & 7) {
            let t = &words[8 * nodes + 9 * i as usize..];
            let corner = |n: usize| [t[0] + t[3 * n], t[1] + t[3 * n + 1], t[2] + t[3 * n + 2]];
            let triangle = [[t[0], t[1], t[2]], corner(1), corner(2)];
            let hit = hit::Ray::new(origin.map(f64::from), direction.map(f64::from)).and_then(|ray| ray.hit(&triangle));
            if let Some(t) = hit.map(|t| t as f32)
                && t >= 0.0
                && nearest.is_none_or(|n| t < n)
            {
                nearest = Some(t);
            }
        }
        at += 1;
    }
    nearest
}

fn number() -> std::ops::Range<f32> {
    -1.0_f32..1.0
}

/// Soups of several kinds: spread, in clusters of growing distance, flat, long splinters, many in one place.
fn soup() -> impl Strategy<Value = Vec<Triangle>> {
    let corner = prop::array::uniform3(number());
    let triangle = (prop::array::uniform3(corner.clone()), corner, 0.001_f32..1.0);
    (prop::collection::vec(triangle, 1..200), 0..5).prop_map(|(parts, kind)| {
        let place = |(n, (shape, at, size)): (usize, (Triangle, [f32; 3], f32))| -> Triangle {
            shape.map(|c| match kind {
                0 => std::array::from_fn(|i| at[i] + 0.2 * size * c[i]),
                1 => std::array::from_fn(|i| (0.5_f32.powi((n % 30) as i32)) * (1.0 + at[i] + c[i])),
                2 => [at[0] + 0.1 * c[0], at[1] + 0.1 * c[1], 0.25],
                3 => [c[0], at[1] + 0.01 * c[1], at[2] + 0.01 * c[2]],
                _ => c,
            })
        };
        parts.into_iter().enumerate().map(place).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn nearest_is_what_brute_force_finds(
        triangles in soup(),
        rays in prop::collection::vec((prop::array::uniform3(number()), prop::array::uniform3(number()), 0.0..1.0, 0.0..9.0), 20),
    ) {
        let count = triangles.len();
        let Ok((mesh, warnings)) = Mesh::new(triangles) else { return Ok(()) };
        prop_assert!(!warnings.is_empty() || mesh.triangles().len() == count);
        check_tree(&mesh);
        for (k, (origin, direction, low, length)) in rays.into_iter().enumerate() {
            let (origin, mut direction) = (origin.map(|x| f64::from(x) * 2.0), direction.map(f64::from));
            // Some along an axis.
            for (i, d) in direction.iter_mut().enumerate() {
                *d = if k % 4 == 0 && i != k % 3 { 0.0 } else { *d };
            }
            let range = (if k % 2 == 0 { 0.0 } else { low }, if k % 5 == 0 { f64::INFINITY } else { low + length });
            let (expected, clear) = brute_force(&mesh, origin, direction, range);
            if !clear {
                continue;
            }
            let found = mesh.nearest(origin, direction, range);
            prop_assert_eq!(found.is_some(), expected.is_some(), "{:?} {:?} {:?}", origin, direction, range);
            if let (Some((t, triangle)), Some(expected)) = (found, expected) {
                prop_assert!((t - expected).abs() <= 1e-7 * (1.0 + expected), "{t} is not {expected}");
                let here = plain_hit(&mesh.triangles()[triangle], origin, direction);
                prop_assert!(here.is_some_and(|(u, _)| (u - t).abs() <= 1e-7 * (1.0 + t)), "the triangle is another");
            }
        }
    }

    #[test]
    fn packed_trees_give_the_same(
        triangles in soup(),
        scale in prop::sample::select(vec![1.0, 1e-3, 7.3, 1e6]),
        rays in prop::collection::vec((prop::array::uniform3(number()), prop::array::uniform3(number())), 10),
    ) {
        let Ok((mesh, _)) = Mesh::new(triangles) else { return Ok(()) };
        let words = mesh.pack(scale);
        prop_assert_eq!(words.len(), 8 * mesh.node_count() + 9 * mesh.triangles().len());
        for (origin, direction) in rays {
            let (expected, clear) = brute_force(&mesh, origin.map(f64::from), direction.map(f64::from), (0.0, 1e9));
            // In f32 the neighbourhood of edges is wider.
            let near_edge = mesh.triangles().iter().filter_map(|t| plain_hit(t, origin.map(f64::from), direction.map(f64::from)))
                .any(|(_, inside)| inside.abs() < 1e-2);
            if !clear || near_edge {
                continue;
            }
            let found = packed_nearest(&words, mesh.node_count(), origin.map(|x| (f64::from(x) * scale) as f32), direction);
            prop_assert_eq!(found.is_some(), expected.is_some());
            if let (Some(found), Some(expected)) = (found, expected) {
                prop_assert!((f64::from(found) / scale - expected).abs() <= 1e-2 * (1.0 + expected), "{found} {expected}");
            }
        }
    }
}

/// An octahedron whose faces were divided n times, its corners moved out to a bumpy sphere: closed, and of odd numbers.
fn ball(n: u32) -> Vec<Triangle> {
    let bumpy = |p: [f64; 3]| {
        let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        let radius = 1.0 + 0.1 * (7.0 * p[0] / length).sin() * (5.0 * p[1] / length).cos();
        p.map(|x| (x / length * radius) as f32)
    };
    let mut faces = vec![];
    for signs in 0..8 {
        let s = |bit: i32| if signs & bit == 0 { 1.0 } else { -1.0 };
        faces.push([[s(1), 0.0, 0.0], [0.0, s(2), 0.0], [0.0, 0.0, s(4)]]);
    }
    for _ in 0..n {
        let middle = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| 0.5 * (a[i] + b[i])) };
        faces = faces
            .iter()
            .flat_map(|[a, b, c]| {
                let (d, e, f) = (middle(*a, *b), middle(*b, *c), middle(*c, *a));
                [[*a, d, f], [d, *b, e], [f, e, *c], [d, e, f]]
            })
            .collect();
    }
    faces.iter().map(|f| f.map(bumpy)).collect()
}

#[test]
fn no_ray_leaks_out_of_a_closed_surface() {
    let (mesh, warnings) = Mesh::new(ball(4)).expect("a ball");
    assert_eq!((mesh.triangles().len(), warnings), (2048, vec![]));
    let depth = check_tree(&mesh);
    assert!(depth < 20, "a tree of depth {depth}");
    let mut rays = 0;
    for origin in [[0.0; 3], [0.3, -0.2, 0.1], [1e-3, 0.7, -0.3], [-0.25, 0.25, 0.5]] {
        for [a, b, c] in mesh.triangles().iter().map(|t| t.map(|p| p.map(f64::from))) {
            let mix = |u: f64, v: f64| std::array::from_fn(|i| a[i] + u * (b[i] - a[i]) + v * (c[i] - a[i]));
            // Through corners, through points of edges, and through the face.
            for target in [a, b, mix(0.5, 0.0), mix(0.5, 0.5), mix(0.3, 0.7), mix(0.0, 0.123), mix(0.3, 0.3)] {
                let direction: [f64; 3] = std::array::from_fn(|i| target[i] - origin[i]);
                let hit = mesh.nearest(origin, direction, (0.0, f64::INFINITY));
                let (t, _) = hit.unwrap_or_else(|| panic!("{origin:?} to {target:?} leaks"));
                // It may meet another wall first, but none behind the target.
                assert!(t <= 1.0 + 1e-9, "{origin:?} to {target:?}: {t}");
                rays += 1;
            }
        }
    }
    assert_eq!(rays, 4 * 2048 * 7);
}

#[test]
fn trees_stay_shallow_whatever_the_soup() {
    let at = |x: f32, size: f32| [[x, 0.0, 0.0], [x + size, 0.0, 0.0], [x, size, 0.0]];
    let cases: Vec<(&str, Vec<Triangle>)> = vec![
        ("all the same", vec![at(0.0, 1.0); 5000]),
        ("in a row", (0..5000).map(|n| at(n as f32, 0.5)).collect()),
        ("ever farther", (0..250).map(|n| at(2.0_f32.powi(n - 125), 2.0_f32.powi(n - 126))).collect()),
        ("ever farther, many of each", (0..5000).map(|n| at(1.5_f32.powi(n / 25 - 100), 1e-3)).collect()),
        ("nested", (0..5000).map(|n| at(-(1.01_f32.powi(n % 2500)), 3.0 * 1.01_f32.powi(n % 2500))).collect()),
        ("as large as numbers go", (0..100).map(|n| at(-3e38 + 5e36 * n as f32, 1e36)).collect()),
    ];
    for (what, triangles) in cases {
        let (mesh, _) = Mesh::new(triangles).expect(what);
        let depth = check_tree(&mesh);
        assert!(depth < 64 + 14, "{what}: {depth}");
    }
}

#[test]
fn rays_from_far_away_and_along_faces() {
    let (mesh, _) = load("a.ply", ply("binary_little_endian", Types("double", "uchar", "int"))).expect("the cube");
    let all = (0.0, f64::INFINITY);
    // 1e9 m away, through the diagonal that two triangles share.
    let (t, _) = mesh.nearest([1.5, 1.5, -1e9], [0.0, 0.0, 1.0], all).expect("the cube");
    assert_eq!(t, 1e9 + 1.0);
    // t counts in lengths of the direction; ranges are closed.
    for scale in [1e-30, 1.0, 1e30] {
        let (t, _) = mesh.nearest([1.25, 1.5, 0.0], [0.0, 0.0, 2.0 * scale], all).expect("the cube");
        assert!((t * scale - 0.5).abs() < 1e-15, "{t}");
    }
    assert_eq!(mesh.nearest([1.25, 1.5, 0.0], [0.0, 0.0, 1.0], (1.0, 1.0)).map(|h| h.0), Some(1.0));
    assert_eq!(mesh.nearest([1.25, 1.5, 0.0], [0.0, 0.0, 1.0], (1.5, 3.0)).map(|h| h.0), Some(2.0));
    assert_eq!(mesh.nearest([1.25, 1.5, 0.0], [0.0, 0.0, 1.0], (0.0, 0.5)), None);
    assert_eq!(mesh.nearest([1.25, 1.5, 0.0], [0.0, 0.0, -1.0], all), None);
    // On a wall, in its plane: the walls across the ray are met at their edges.
    assert_eq!(mesh.nearest([0.0, 1.0, 1.5], [1.0, 0.0, 0.0], all).map(|h| h.0), Some(1.0));
    // What is no ray meets nothing.
    for (origin, direction) in [
        ([0.0; 3], [0.0; 3]),
        ([0.0; 3], [f64::NAN, 1.0, 0.0]),
        ([f64::NAN; 3], [1.0; 3]),
        ([0.0; 3], [f64::INFINITY; 3]),
    ] {
        assert_eq!(mesh.nearest(origin, direction, all), None);
    }
}
