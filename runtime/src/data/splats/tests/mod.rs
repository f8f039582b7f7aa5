//! Files are made in memory, by code that shares nothing with the readers.

mod hostile;
mod read;

use super::*;
use crate::data::Memory;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;

fn load(name: &str, bytes: impl Into<Vec<u8>>) -> Result<(Splats, Vec<LoadWarning>), LoadError> {
    read_splats_from(&Memory::one(name, bytes), Path::new(name))
}

/// A splat as a PLY file has it: deviations as logarithms, opacity as logit.
#[derive(Clone, Debug)]
struct Plain {
    center: [f32; 3],
    color: [f32; 3],
    /// By channel, then by coefficient.
    rest: Vec<f32>,
    opacity: f32,
    scale: [f32; 3],
    rotation: [f32; 4],
}

/// Some splats that differ in every number. Values keep to what SPZ can hold.
fn some(count: usize, degree: u8) -> Vec<Plain> {
    let above = coefficients(degree) - 1;
    (0..count)
        .map(|i| {
            let x = |k: usize| ((i * 37 + k * 11) % 61) as f32 / 61.0 - 0.5;
            Plain {
                center: [8.0 * x(0), 8.0 * x(1), 8.0 * x(2)],
                color: [3.0 * x(3), 3.0 * x(4), 3.0 * x(5)],
                rest: (0..3 * above).map(|k| x(6 + k)).collect(),
                opacity: 8.0 * x(7),
                scale: [x(8) - 3.0, x(9) - 4.0, x(10) - 2.0],
                rotation: [x(11) + 0.9, x(12), x(13), -x(14)],
            }
        })
        .collect()
}

fn header(format: &str, count: usize, rest: usize) -> String {
    let mut text = format!("ply\nformat {format} 1.0\ncomment made by hand\nelement vertex {count}\n");
    let mut names: Vec<String> = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(Into::into).into();
    names.extend((0..rest).map(|i| format!("f_rest_{i}")));
    names.extend(["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"].map(Into::into));
    names.iter().for_each(|n| text += &format!("property float {n}\n"));
    text + "end_header\n"
}

fn ply(format: &str, splats: &[Plain]) -> Vec<u8> {
    let mut bytes = header(format, splats.len(), splats[0].rest.len()).into_bytes();
    for s in splats {
        let mut row: Vec<f32> = vec![];
        row.extend(s.center);
        row.extend([9.0, 8.0, 7.0]);
        row.extend(s.color);
        row.extend(&s.rest);
        row.push(s.opacity);
        row.extend(s.scale);
        row.extend(s.rotation);
        match format {
            "ascii" => {
                let words: Vec<String> = row.iter().map(ToString::to_string).collect();
                bytes.extend((words.join(" ") + "\n").bytes());
            }
            "binary_big_endian" => bytes.extend(row.iter().flat_map(|x| x.to_be_bytes())),
            _ => bytes.extend(row.iter().flat_map(|x| x.to_le_bytes())),
        }
    }
    bytes
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = GzEncoder::new(vec![], Compression::fast());
    out.write_all(bytes).expect("in memory");
    out.finish().expect("in memory")
}

/// The stream of an SPZ file before it is compressed.
fn spz_stream(version: u32, degree: u8, flags: u8, splats: &[Plain]) -> Vec<u8> {
    let mut out = b"NGSP".to_vec();
    out.extend(version.to_le_bytes());
    out.extend((splats.len() as u32).to_le_bytes());
    out.extend([degree, 12, flags, 0]);
    let byte = |x: f32| x.round().clamp(0.0, 255.0) as u8;
    for s in splats {
        out.extend(s.center.iter().flat_map(|x| ((x * 4096.0).round() as i32).to_le_bytes()[..3].to_vec()));
    }
    out.extend(splats.iter().map(|s| byte(255.0 / (1.0 + (-s.opacity).exp()))));
    out.extend(splats.iter().flat_map(|s| s.color.map(|c| byte((c * 0.15 + 0.5) * 255.0))));
    out.extend(splats.iter().flat_map(|s| s.scale.map(|x| byte((x + 10.0) * 16.0))));
    for s in splats {
        let norm = s.rotation.iter().map(|x| x * x).sum::<f32>().sqrt();
        let [w, x, y, z] = s.rotation.map(|q| q / norm);
        if version == 2 {
            out.extend([x, y, z].map(|q| byte(127.5 * q * w.signum() + 127.5)));
            continue;
        }
        let q = [x, y, z, w];
        let largest = (0..4).max_by(|a, b| q[*a].abs().total_cmp(&q[*b].abs())).expect("four");
        let mut word = largest as u32;
        for i in (0..4).filter(|i| *i != largest) {
            let v = q[i] * q[largest].signum();
            let size = (511.0 * v.abs() * std::f32::consts::SQRT_2).round() as u32;
            word = word << 10 | u32::from(v < 0.0) << 9 | size;
        }
        out.extend(word.to_le_bytes());
    }
    for s in splats {
        let above = s.rest.len() / 3;
        out.extend((0..above).flat_map(|k| [0, 1, 2].map(|c| byte(s.rest[c * above + k] * 128.0 + 128.0))));
    }
    out
}
