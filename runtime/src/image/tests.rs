use super::*;
use ::exr::prelude::{ReadChannels, ReadLayers};
use compiler::ir::Tonemap;
use std::path::PathBuf;
use tempfile::TempDir;

fn rgb() -> Bands {
    Bands { kind: BandsKind::Rgb, wavelengths: vec![680e-9, 550e-9, 440e-9] }
}

fn gray() -> Bands {
    Bands { kind: BandsKind::Gray, wavelengths: vec![550e-9] }
}

fn list(nm: &[f64]) -> Bands {
    Bands { kind: BandsKind::List, wavelengths: nm.iter().map(|l| l * 1e-9).collect() }
}

fn row(bands: Bands, radiance: &[f32]) -> Picture {
    let width = (radiance.len() / bands.wavelengths.len()) as u32;
    Picture::new([width, 1], bands, radiance.to_vec(), None).unwrap()
}

fn scratch(name: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

fn display(tonemap: Tonemap, exposure: f64) -> Display {
    Display { exposure, tonemap }
}

/// Writes and reads back with another crate.
fn png_back(picture: &Picture, options: &WriteOptions) -> (::image::DynamicImage, Written) {
    let (_folder, path) = scratch("a.png");
    let written = write(&path, picture, options).unwrap();
    (::image::open(&path).unwrap(), written)
}

#[test]
fn srgb_follows_the_standard() {
    // Codes of IEC 61966-2-1 at both sides of the joint, at middle grey and at white.
    for (linear, code) in
        [(0.0, 0.0), (0.001, 3.2946), (0.0031308, 10.3147), (0.18, 117.6461), (0.5, 187.5160), (1.0, 255.0)]
    {
        assert!((srgb_encode(linear) * 255.0 - code).abs() < 1e-3, "{linear}: {}", srgb_encode(linear) * 255.0);
    }
    for n in 0..=1000 {
        let x = f64::from(n) / 1000.0;
        assert!((srgb_decode(srgb_encode(x)) - x).abs() < 1e-7, "{x}");
    }
}

#[test]
fn halves_round_up_at_both_depths() {
    // Just under and just over the middle between two codes.
    for (highest, depth) in [(255.0, Depth::Eight), (65535.0, Depth::Sixteen)] {
        for code in [0.0, 7.0, 100.0, 200.0, 254.0] {
            let middle = srgb_decode((code + 0.5) / highest);
            let below = (middle * (1.0 - 1e-6)) as f32;
            let above = (middle * (1.0 + 1e-6)) as f32;
            let (image, _) = png_back(&row(gray(), &[below, above]), &WriteOptions { depth, ..Default::default() });
            let codes: Vec<f64> = match depth {
                Depth::Eight => image.into_luma8().iter().map(|v| f64::from(*v)).collect(),
                Depth::Sixteen => image.into_luma16().iter().map(|v| f64::from(*v)).collect(),
            };
            assert_eq!(codes, [code, code + 1.0]);
        }
    }
}

#[test]
fn values_are_clamped_and_infinity_is_white() {
    let values = [f32::NEG_INFINITY, -1.0, 0.0, 1.0, 7.0, f32::INFINITY];
    for tonemap in [Tonemap::None, Tonemap::Reinhard, Tonemap::Aces, Tonemap::Exposure] {
        let options = WriteOptions { display: display(tonemap, 0.0), ..Default::default() };
        let (image, written) = png_back(&row(gray(), &values), &options);
        let codes = image.into_luma8().into_raw();
        assert_eq!((codes[0], codes[1], codes[2], codes[5]), (0, 0, 0, 255), "{tonemap:?} {codes:?}");
        assert_eq!(written.nan, 0);
        let shown = row(rgb(), &[f32::INFINITY, 0.0, f32::MAX]).shown(&display(tonemap, 1e6));
        assert_eq!(shown.pixels, [[1.0, 0.0, 1.0]], "{tonemap:?}");
    }
}

#[test]
fn nan_is_magenta_and_counted() {
    let (image, written) = png_back(&row(gray(), &[0.0, f32::NAN, 1.0]), &WriteOptions::default());
    assert_eq!(written.nan, 1);
    assert_eq!(image.into_rgb8().into_raw(), [0, 0, 0, 255, 0, 255, 255, 255, 255]);
}

#[test]
fn tone_maps_follow_their_formulas() {
    let at = |tonemap, exposure, x: f32| {
        srgb_decode(f64::from(row(gray(), &[x]).shown(&display(tonemap, exposure)).pixels[0][0]))
    };
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} is not {b}");
    near(at(Tonemap::None, 0.0, 0.25), 0.25);
    near(at(Tonemap::None, 1.0, 0.25), 0.5);
    near(at(Tonemap::None, -2.0, 1.0), 0.25);
    near(at(Tonemap::Reinhard, 0.0, 3.0), 0.75);
    near(at(Tonemap::Reinhard, 1.0, 0.5), 0.5);
    near(at(Tonemap::Exposure, 0.0, 1.0), 1.0 - (-1.0_f64).exp());
    near(at(Tonemap::Aces, 0.0, 0.5), 0.5 * (2.51 * 0.5 + 0.03) / (0.5 * (2.43 * 0.5 + 0.59) + 0.14));
    // Every curve rises.
    for tonemap in [Tonemap::None, Tonemap::Reinhard, Tonemap::Aces, Tonemap::Exposure] {
        let values: Vec<f64> = (0..200).map(|n| at(tonemap, 0.0, n as f32 / 20.0)).collect();
        assert!(values.windows(2).all(|w| w[0] <= w[1]), "{tonemap:?}");
    }
}

#[test]
fn png_holds_the_scene_and_the_colours() {
    let (_folder, path) = scratch("a.png");
    let scene = "medium a { k_a = 1 /m }\n// Туман · τ → ∞\n".repeat(200);
    let picture =
        Picture::new([2, 2], rgb(), vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], None).unwrap();
    for depth in [Depth::Eight, Depth::Sixteen] {
        let options = WriteOptions { depth, scene: Some(scene.clone()), ..Default::default() };
        write(&path, &picture, &options).unwrap();
        assert_eq!(read_png_scene(&path).unwrap(), scene);
        let shown = read_png(&path).unwrap();
        assert_eq!(shown, picture.shown(&Display::default()));
        assert_eq!(shown.pixels, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]]);
    }
    let info = ::png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).unwrap())).read_info().unwrap();
    assert!(info.info().srgb.is_some());
    assert!(info.info().utf8_text.iter().any(|t| t.keyword == "Software"));
    write(&path, &picture, &WriteOptions::default()).unwrap();
    assert_eq!(read_png_scene(&path).unwrap_err().code, "E0622");
    std::fs::write(&path, b"no picture").unwrap();
    assert_eq!(read_png_scene(&path).unwrap_err().code, "E0622");
    assert_eq!(read_png(&path).unwrap_err().code, "E0622");
    assert_eq!(read_png(&path.with_extension("missing")).unwrap_err().code, "E0622");
}

fn exr_back(picture: &Picture, scene: Option<&str>) -> Vec<(String, Vec<f32>)> {
    let (_folder, path) = scratch("a.exr");
    let options = WriteOptions { scene: scene.map(Into::into), ..Default::default() };
    write(&path, picture, &options).unwrap();
    let image = ::exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(&path)
        .unwrap();
    let kept = image.layer_data.attributes.other.get(&::exr::prelude::Text::from(SCENE_KEYWORD));
    let kept = kept.map(|value| match value {
        ::exr::prelude::AttributeValue::Text(text) => String::from_utf8(text.as_slice().to_vec()).unwrap(),
        other => panic!("{other:?}"),
    });
    assert_eq!(kept.as_deref(), scene);
    assert_eq!((image.layer_data.size.0 as u32, image.layer_data.size.1 as u32), (picture.width, picture.height));
    let channels = image.layer_data.channel_data.list;
    channels.into_iter().map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect()
}

#[test]
fn exr_keeps_linear_radiance_and_transmittance() {
    let radiance = vec![0.5, 1e-30, 1e30, -0.25, 4.0, f32::INFINITY];
    let transmittance = vec![1.0, 0.5, 0.25, 0.125, 0.0, 1e-20];
    let picture = Picture::new([1, 2], rgb(), radiance, Some(transmittance)).unwrap();
    let channels = exr_back(&picture, Some("light a { } // Туман"));
    let expected: Vec<(String, Vec<f32>)> = [
        ("B", vec![1e30, f32::INFINITY]),
        ("G", vec![1e-30, 4.0]),
        ("R", vec![0.5, -0.25]),
        ("T.B", vec![0.25, 1e-20]),
        ("T.G", vec![0.5, 0.0]),
        ("T.R", vec![1.0, 0.125]),
    ]
    .map(|(name, values)| (name.to_string(), values))
    .to_vec();
    assert_eq!(channels, expected);
}

#[test]
fn exr_names_bands_by_wavelength() {
    let names = |bands: Bands| -> Vec<String> {
        let n = bands.wavelengths.len();
        exr_back(&row(bands, &vec![1.0; n]), None).into_iter().map(|c| c.0).collect()
    };
    assert_eq!(names(gray()), ["Y"]);
    assert_eq!(names(list(&[680.0, 562.5, 440.0])), ["440nm", "562,5nm", "680nm"]);
    assert_eq!(names(list(&[550.0, 550.0])), ["550nm", "550nm'"]);
    // Sorted, as the format wants them.
    assert_eq!(names(Bands::spectral(5)), ["420nm", "500nm", "580nm", "660nm", "740nm"]);
    assert_eq!(names(Bands::spectral(3))[0], "446,667nm");
    assert_eq!(names(Bands::spectral(64)).len(), 64);
}

#[test]
fn npy_is_rows_of_pixels_of_bands() {
    let (_folder, path) = scratch("a.npy");
    let values: Vec<f32> = (0..24).map(|n| n as f32 * 0.1).collect();
    let picture = Picture::new([4, 3], list(&[600.0, 500.0]), values.clone(), None).unwrap();
    write(&path, &picture, &WriteOptions::default()).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let npy = npyz::NpyFile::new(&bytes[..]).unwrap();
    assert_eq!(npy.shape(), [3, 4, 2]);
    assert_eq!(npy.order(), npyz::Order::C);
    assert_eq!(npy.dtype().descr(), "'<f4'");
    assert_eq!(npy.into_vec::<f32>().unwrap(), values);
    assert_eq!(picture.pixel(1, 2), &values[18..20]);
}

#[test]
fn other_endings_and_places_are_refused() {
    let (folder, path) = scratch("a.jpg");
    let picture = row(gray(), &[0.5]);
    let error = write(&path, &picture, &WriteOptions::default()).unwrap_err();
    assert_eq!(error.code, "E0621");
    assert!(error.hint.unwrap().contains(".exr"));
    assert_eq!(write(Path::new("picture"), &picture, &WriteOptions::default()).unwrap_err().code, "E0621");
    for ending in ["png", "exr", "npy"] {
        let missing = folder.path().join("missing").join("a").with_extension(ending);
        let error = write(&missing, &picture, &WriteOptions::default()).unwrap_err();
        assert_eq!(error.code, "E0620");
        assert!(error.hint.unwrap().contains("missing"));
    }
}

#[test]
fn pictures_need_pixels_that_fit() {
    let code = |size, bands: Bands, n, t: Option<usize>| {
        Picture::new(size, bands, vec![0.0; n], t.map(|n| vec![0.0; n])).map(|_| ()).map_err(|e| e.code)
    };
    assert_eq!(code([2, 2], gray(), 4, Some(4)), Ok(()));
    assert_eq!(code([2, 2], gray(), 5, None), Err("E0620"));
    assert_eq!(code([2, 2], gray(), 4, Some(3)), Err("E0620"));
    assert_eq!(code([0, 2], gray(), 0, None), Err("E0620"));
    assert_eq!(code([1, 1], list(&[]), 0, None), Err("E0620"));
    assert_eq!(code([u32::MAX, u32::MAX], rgb(), 3, None), Err("E0620"));
}

mod metrics {
    use super::metric::*;
    use super::*;

    fn shown(width: u32, height: u32, f: impl Fn(u32, u32) -> [f32; 3]) -> Shown {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect();
        Shown { width, height, pixels }
    }

    /// Smooth in colour, with an edge and a point.
    fn scene(x: u32, y: u32) -> [f32; 3] {
        let (u, v) = (x as f32 / 48.0, y as f32 / 40.0);
        if x > 30 {
            [0.8, 0.2 + 0.5 * v, 0.1]
        } else if (x, y) == (12, 20) {
            [1.0; 3]
        } else {
            [0.2 + 0.6 * u, v, 0.5]
        }
    }

    fn flip_of(a: &Shown, b: &Shown) -> f64 {
        compare(a, b).unwrap().flip
    }

    #[test]
    fn a_picture_does_not_differ_from_itself() {
        let a = shown(48, 40, scene);
        let d = compare(&a, &a).unwrap();
        assert_eq!((d.max, d.rms, d.mean_abs, d.flip), (0.0, 0.0, 0.0, 0.0));
        assert!(d.flip_map.iter().all(|v| *v == 0.0));
    }

    #[test]
    fn plain_statistics() {
        let a = shown(2, 1, |_, _| [0.5; 3]);
        let b = shown(2, 1, |x, _| if x == 0 { [0.5, 0.5, 0.75] } else { [0.5; 3] });
        let d = compare(&a, &b).unwrap();
        assert!((d.max - 0.25).abs() < 1e-7);
        assert!((d.mean_abs - 0.25 / 6.0).abs() < 1e-7);
        assert!((d.rms - 0.25 / 6.0_f64.sqrt()).abs() < 1e-7);
    }

    #[test]
    fn flip_stays_between_0_and_1_even_for_opposites() {
        for (a, b) in [([0.0; 3], [1.0; 3]), ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]), ([1.0, 0.0, 0.0], [0.0, 1.0, 1.0])] {
            let (a, b) = (shown(20, 20, |_, _| a), shown(20, 20, |_, _| b));
            let d = compare(&a, &b).unwrap();
            assert!(d.flip > 0.8 && d.flip_map.iter().all(|v| (0.0..=1.0).contains(v)), "{}", d.flip);
        }
        let noise = |seed: u32| {
            shown(33, 17, move |x, y| {
                let bit = |n: u32| ((x * 7919 + y * 104729 + seed + n).wrapping_mul(2654435761) >> 31) as f32;
                [bit(0), bit(1), bit(2)]
            })
        };
        assert!(compare(&noise(1), &noise(2)).unwrap().flip_map.iter().all(|v| (0.0..=1.0).contains(v)));
    }

    #[test]
    fn flip_agrees_with_the_program_of_its_authors() {
        // Means from `flip_evaluator` 1.7 on the same pictures. It computes in f32, and the square root of the feature
        // difference makes 1e-5 out of a rounding error of 1e-7.
        let near = |name: &str, a: &Shown, b: &Shown, mean: f64| {
            let ours = flip_of(a, b);
            assert!((ours - mean).abs() < 1e-5, "{name}: {ours}, not {mean}");
        };
        let a = shown(48, 40, scene);
        // They also grow with the difference.
        for (by, mean) in [
            (0.002, 0.025166280),
            (0.01, 0.080463834),
            (0.05, 0.251644373),
            (0.1, 0.403449923),
            (0.2, 0.625470698),
            (0.4, 0.871133149),
        ] {
            let brighter = shown(48, 40, |x, y| scene(x, y).map(|v| (v + by).min(1.0)));
            near("brighter", &a, &brighter, mean);
        }
        let dot = shown(48, 40, |x, y| if (x, y) == (12, 20) { [0.3, 0.5, 0.5] } else { scene(x, y) });
        near("dot", &a, &dot, 0.002659611);
        near("shift", &a, &shown(48, 40, |x, y| scene((x + 47) % 48, y)), 0.109202974);
        let (black, white) = (shown(20, 20, |_, _| [0.0; 3]), shown(20, 20, |_, _| [1.0; 3]));
        near("white", &black, &white, 0.967386186);
        let (green, blue) = (shown(20, 20, |_, _| [0.0, 1.0, 0.0]), shown(20, 20, |_, _| [0.0, 0.0, 1.0]));
        near("blue", &green, &blue, 1.0);
    }

    #[test]
    fn flip_forgives_what_cannot_be_seen() {
        // A fine checkerboard blends with the grey of the same light at this distance; a coarse one does not.
        let middle = srgb_encode(0.5) as f32;
        let a = shown(64, 64, |_, _| [middle; 3]);
        let board = |n: u32| shown(64, 64, move |x, y| [((x / n + y / n) % 2) as f32; 3]);
        let error = |n: u32| flip_of(&a, &board(n));
        assert!(error(1) < 0.01 && error(4) > 0.4 && error(4) < error(16), "{} {} {}", error(1), error(4), error(16));
    }

    #[test]
    fn sizes_must_agree() {
        let (a, b) = (shown(4, 4, scene), shown(4, 5, scene));
        assert_eq!(compare(&a, &b).unwrap_err().code, "E0620");
        let empty = Shown { width: 0, height: 0, pixels: vec![] };
        assert_eq!(compare(&empty, &empty).unwrap_err().code, "E0620");
        let lying = Shown { width: 9, height: 9, pixels: vec![[0.0; 3]] };
        assert_eq!(compare(&lying, &lying).unwrap_err().code, "E0620");
        assert!(compare(&shown(1, 1, scene), &shown(1, 1, scene)).is_ok());
    }
}
