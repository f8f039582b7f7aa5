//! Three numbers in f64: the host's positions and directions.

/// A position, direction or difference.
pub type Vec3 = [f64; 3];

pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] + b[i])
}

pub(crate) fn sub(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(crate) fn scale(a: Vec3, s: f64) -> Vec3 {
    a.map(|x| x * s)
}

/// `o + t·d`, rounded once per component.
pub(crate) fn along(o: Vec3, d: Vec3, t: f64) -> Vec3 {
    std::array::from_fn(|i| d[i].mul_add(t, o[i]))
}

pub(crate) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Length without overflow or underflow in the squares.
pub(crate) fn length(a: Vec3) -> f64 {
    let m = a.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    if m == 0.0 || !m.is_finite() {
        return m;
    }
    let b = a.map(|x| x / m);
    m * dot(b, b).sqrt()
}

/// Unit vector, or `None` for a zero or non-finite one.
pub(crate) fn normalize(a: Vec3) -> Option<Vec3> {
    let l = length(a);
    (l > 0.0 && l.is_finite()).then(|| {
        let u = a.map(|x| x / l);
        // Once more, so that the result is a unit vector to the last bit or two.
        let l = dot(u, u).sqrt();
        u.map(|x| x / l)
    })
}

pub(crate) fn is_finite(a: Vec3) -> bool {
    a.iter().all(|x| x.is_finite())
}
