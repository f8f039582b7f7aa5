//! OpenEXR: linear radiance, one 32-bit channel per band, and transmittance.

use super::{ImageError, Picture, SCENE_KEYWORD, Written};
use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer};
use exr::meta::attribute::{AttributeValue, Text};
use exr::meta::header::LayerAttributes;
use exr::prelude::{SmallVec, WritableImage};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes radiance as `R`, `G`, `B`, as `Y`, or as `550nm` …, and transmittance, if there is one, under the same names in
/// a layer `T` (`T.R`). The scene goes into the attribute `tyndall:scene` as UTF-8. Compression is lossless.
///
/// # Errors
/// `E0620`.
pub fn write_exr(path: &Path, picture: &Picture, scene: Option<&str>) -> Result<Written, ImageError> {
    let fail = |e: &dyn std::fmt::Display| ImageError::write_to(path, e);
    // Bands that agree to a thousandth of a nanometre would have one name.
    let mut names = picture.band_names();
    for at in 1..names.len() {
        while names[..at].contains(&names[at]) {
            names[at].push('\'');
        }
    }
    let channel = |name: String, values: &[f32], band: usize| {
        let samples = values.iter().skip(band).step_by(names.len()).copied().collect();
        AnyChannel::new(Text::from(name.as_str()), FlatSamples::F32(samples))
    };
    let mut channels = SmallVec::new();
    for (band, name) in names.iter().enumerate() {
        channels.push(channel(name.clone(), &picture.radiance, band));
        if let Some(transmittance) = &picture.transmittance {
            channels.push(channel(format!("T.{name}"), transmittance, band));
        }
    }
    let mut attributes = LayerAttributes {
        software_name: Some(Text::from(concat!("Tyndall ", env!("CARGO_PKG_VERSION")))),
        ..LayerAttributes::default()
    };
    if let Some(scene) = scene {
        // OpenEXR strings are bytes; UTF-8 is what viewers expect.
        let text = Text::from_slice_unchecked(scene.as_bytes());
        attributes.other.insert(Text::from(SCENE_KEYWORD), AttributeValue::Text(text));
    }
    let size = (picture.width as usize, picture.height as usize);
    let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(channels));
    let mut file = BufWriter::new(File::create(path).map_err(|e| fail(&e))?);
    Image::from_layer(layer).write().to_buffered(&mut file).map_err(|e| fail(&e))?;
    file.flush().map_err(|e| fail(&e))?;
    Ok(Written { nan: super::count_nan(picture) })
}
