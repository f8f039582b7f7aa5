//! PNG: the picture as shown, with the scene in a text chunk.

use super::{Depth, ImageError, Picture, Shown, WriteOptions, Written};
use compiler::ir::BandsKind;
use png::{BitDepth, ColorType, Decoder, Encoder, Reader, SrgbRenderingIntent, Transformations};
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::Path;

/// Keyword of the text chunk that holds the scene.
pub const SCENE_KEYWORD: &str = "tyndall:scene";

/// The highest code times the encoded value, halves rounded up.
fn quantise(value: f64, highest: f64) -> f64 {
    (value * highest + 0.5).floor().clamp(0.0, highest)
}

/// Writes what [`super::Display`] makes of the picture, as grey for grey pictures. The scene goes into an `iTXt` chunk
/// [`SCENE_KEYWORD`], the name of the program into `Software`.
///
/// # Errors
/// `E0620`.
pub fn write_png(path: &Path, picture: &Picture, options: &WriteOptions) -> Result<Written, ImageError> {
    let fail = |e: &dyn std::fmt::Display| ImageError::write_to(path, e);
    let (bytes, bits, nan) = match options.depth {
        Depth::Eight => {
            let (pixels, nan) = picture.map_shown(&options.display, |v| [quantise(v, 255.0) as u8]);
            (samples(picture, nan, &pixels), BitDepth::Eight, nan)
        }
        Depth::Sixteen => {
            let store = |v| (quantise(v, 65535.0) as u16).to_be_bytes();
            let (pixels, nan) = picture.map_shown(&options.display, store);
            (samples(picture, nan, &pixels), BitDepth::Sixteen, nan)
        }
    };
    let mut file = BufWriter::new(File::create(path).map_err(|e| fail(&e))?);
    let mut encoder = Encoder::new(&mut file, picture.width, picture.height);
    encoder.set_color(if is_grey(picture, nan) { ColorType::Grayscale } else { ColorType::Rgb });
    encoder.set_depth(bits);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    encoder
        .add_itxt_chunk("Software".into(), concat!("Tyndall ", env!("CARGO_PKG_VERSION")).into())
        .map_err(|e| fail(&e))?;
    if let Some(scene) = &options.scene {
        encoder.add_itxt_chunk(SCENE_KEYWORD.into(), scene.clone()).map_err(|e| fail(&e))?;
    }
    let mut writer = encoder.write_header().map_err(|e| fail(&e))?;
    writer.write_image_data(&bytes).map_err(|e| fail(&e))?;
    writer.finish().map_err(|e| fail(&e))?;
    file.flush().map_err(|e| fail(&e))?;
    Ok(Written { nan })
}

/// A small PNG in memory: eight bits, as shown.
///
/// # Errors
/// `E0620` when there is no pixel.
pub fn png_bytes(shown: &Shown) -> Result<Vec<u8>, ImageError> {
    let fail = |e: png::EncodingError| ImageError::write(format!("a picture cannot be encoded: {e}"));
    let mut out = vec![];
    let mut encoder = Encoder::new(&mut out, shown.width, shown.height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    let mut writer = encoder.write_header().map_err(fail)?;
    let bytes: Vec<u8> = shown.pixels.iter().flatten().map(|v| quantise(f64::from(*v), 255.0) as u8).collect();
    writer.write_image_data(&bytes).map_err(fail)?;
    writer.finish().map_err(fail)?;
    Ok(out)
}

/// A grey picture with NaN in it needs colour to show that.
fn is_grey(picture: &Picture, nan: usize) -> bool {
    picture.bands.kind == BandsKind::Gray && nan == 0
}

/// The bytes of the samples in the order of the file.
fn samples<const N: usize>(picture: &Picture, nan: usize, pixels: &[[[u8; N]; 3]]) -> Vec<u8> {
    let channels = if is_grey(picture, nan) { 1 } else { 3 };
    pixels.iter().flat_map(|pixel| &pixel[..channels]).flatten().copied().collect()
}

type PngReader = Reader<BufReader<File>>;

fn open(path: &Path, transformations: Transformations) -> Result<PngReader, ImageError> {
    let file = File::open(path).map_err(|e| ImageError::read(path, &format!("cannot be read: {e}")))?;
    let mut decoder = Decoder::new(BufReader::new(file));
    decoder.set_transformations(transformations);
    decoder.read_info().map_err(|e| ImageError::read(path, &format!("is no PNG that can be read: {e}")))
}

/// The text of the scene in a picture that [`write_png`] wrote.
///
/// # Errors
/// `E0622` when there is none.
pub fn read_png_scene(path: &Path) -> Result<String, ImageError> {
    let mut reader = open(path, Transformations::IDENTITY)?;
    let find = |reader: &PngReader| {
        let chunk = reader.info().utf8_text.iter().find(|chunk| chunk.keyword == SCENE_KEYWORD)?;
        chunk.get_text().ok()
    };
    if let Some(scene) = find(&reader) {
        return Ok(scene);
    }
    // Programs that rewrite pictures like to put text at the end.
    let damaged = |e| ImageError::read(path, &format!("is damaged: {e}"));
    reader.finish().map_err(damaged)?;
    find(&reader).ok_or_else(|| ImageError::read(path, "holds no scene"))
}

/// Reads any PNG as it is shown; transparency is dropped.
///
/// # Errors
/// `E0622` when the file is missing, no PNG, or damaged.
pub fn read_png(path: &Path) -> Result<Shown, ImageError> {
    let damaged = |e: &dyn std::fmt::Display| ImageError::read(path, &format!("is damaged: {e}"));
    let mut reader = open(path, Transformations::EXPAND)?;
    let (width, height) = (reader.info().width, reader.info().height);
    let size = reader.output_buffer_size().ok_or_else(|| damaged(&"it is too large"))?;
    let mut bytes = vec![0; size];
    let frame = reader.next_frame(&mut bytes).map_err(|e| damaged(&e))?;
    let values: Vec<f32> = match frame.bit_depth {
        BitDepth::Sixteen => {
            bytes.chunks_exact(2).map(|b| f32::from(u16::from_be_bytes([b[0], b[1]])) / 65535.0).collect()
        }
        BitDepth::One | BitDepth::Two | BitDepth::Four | BitDepth::Eight => {
            bytes.iter().map(|b| f32::from(*b) / 255.0).collect()
        }
    };
    let channels = frame.color_type.samples();
    let pixels = values
        .chunks_exact(channels)
        .map(|pixel| if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] })
        .collect();
    Ok(Shown { width, height, pixels })
}
