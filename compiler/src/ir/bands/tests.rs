use super::*;

fn list(nm: &[f64]) -> Bands {
    Bands { kind: BandsKind::List, wavelengths: nm.iter().map(|l| l * 1e-9).collect() }
}

/// What a colour is displayed as.
fn shown(bands: &Bands, color: [f64; 3]) -> [f64; 3] {
    let mut out = [0.0; 3];
    for (weights, parts) in bands.display().iter().zip(bands.resample()) {
        let value: f64 = parts.iter().zip(color).map(|(a, b)| a * b).sum();
        (0..3).for_each(|c| out[c] += weights[c] * value);
    }
    out
}

/// Sums of the displayed weights: how even light looks.
fn white(bands: &Bands) -> [f64; 3] {
    bands.display().iter().fold([0.0; 3], |a, b| std::array::from_fn(|c| a[c] + b[c]))
}

fn every_mode() -> Vec<Bands> {
    let mut all: Vec<Bands> = (1..=Bands::MOST as u32).map(Bands::spectral).collect();
    all.push(Bands { kind: BandsKind::Rgb, wavelengths: vec![680e-9, 550e-9, 440e-9] });
    all.push(Bands { kind: BandsKind::Gray, wavelengths: vec![550e-9] });
    all.extend(
        [
            &[550.0][..],
            &[600.0, 500.0],
            &[680.0, 550.0, 440.0],
            &[650.0, 550.0, 450.0],
            &[1000.0, 2000.0, 3000.0],
            &[650.0, 550.0, 500.0, 450.0],
            &[450.0, 600.0, 500.0, 650.0, 550.0],
            &[400.0, 500.0, 600.0, 700.0, 800.0],
            &[1000.0, 2000.0],
            &[550.0, 550.0],
            &[450.0, 550.0, 550.0, 650.0],
            &[600.0, 610.0, 620.0, 630.0, 640.0],
            &[380.0, 480.0, 580.0, 680.0, 780.0],
        ]
        .map(list),
    );
    all
}

#[test]
fn even_light_is_white_in_every_mode() {
    for bands in every_mode() {
        let white = white(&bands);
        assert!(white.iter().all(|c| (c - 1.0).abs() < 1e-9), "{bands}: {white:?}");
    }
}

#[test]
fn spectra_of_colours_are_between_0_and_1_and_make_white() {
    for bands in every_mode() {
        for parts in bands.resample() {
            assert!(parts.iter().all(|p| (0.0..=1.0).contains(p)), "{bands}: {parts:?}");
            assert!((parts.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{bands}: {parts:?}");
        }
    }
}

#[test]
fn colours_are_displayed_as_they_are_written() {
    let faithful = |bands: &Bands| {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.9, 0.4, 0.1], [12.0, 3.0, 40.0]].iter().all(|color| {
            let found = shown(bands, *color);
            (0..3).all(|c| (found[c] - color[c]).abs() < 1e-9)
        })
    };
    for bands in every_mode().iter().filter(|b| b.wavelengths.len() > 1) {
        assert_eq!(bands.shows_colors(), faithful(bands), "{bands}");
    }
    let unable: Vec<String> = every_mode().iter().filter(|b| !b.shows_colors()).map(ToString::to_string).collect();
    let expected = ["480 nm, 680 nm", "600 nm, 500 nm", "1000 nm, 2000 nm", "550 nm, 550 nm"];
    assert_eq!(&unable[..4], expected);
    assert_eq!(unable[4..], ["600 nm, 610 nm, 620 nm, 630 nm, 640 nm"]);
}

/// What is behind XYZ fades as bands come closer: then a spectrum is displayed as the observer sees it under D65.
#[test]
fn many_bands_are_seen_as_the_observer_sees() {
    for (n, most) in [(8, 0.06), (16, 0.015), (31, 0.008), (64, 0.005)] {
        let bands = Bands::spectral(n);
        let (shown, plain) = (bands.display(), bands.plain());
        let pairs = shown.iter().flatten().zip(plain.iter().flatten());
        // In proportion to what bands of this width have.
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) * f64::from(n) / 8.0;
        assert!(off < most, "{n}: {off}");
    }
}

/// Chromaticity (0.31272, 0.32903) of D65 for this observer (CIE 15:2018, table 11.3 gives 0.31272, 0.32903).
#[test]
fn the_tables_have_the_white_of_d65() {
    let [x, y, z] = std::array::from_fn(|c| integral(c, VISIBLE[1]));
    let sum = x + y + z;
    assert!((x / sum - 0.31272).abs() < 2e-5 && (y / sum - 0.32903).abs() < 2e-5, "{} {}", x / sum, y / sum);
}

/// Integrals of the matching functions over wavelength are those of the equal-energy illuminant: all alike.
#[test]
fn the_matching_functions_agree_on_equal_energy() {
    let sums: [f64; 3] = std::array::from_fn(|c| MATCHING.iter().map(|m| m[c]).sum());
    assert!(sums.iter().all(|s| (s / sums[1] - 1.0).abs() < 3e-4), "{sums:?}");
}

#[test]
fn groups_are_neighbours_and_even() {
    let sizes = |n: u32| Bands::spectral(n).groups().iter().map(Range::len).collect::<Vec<_>>();
    assert_eq!(sizes(1), [1]);
    assert_eq!(sizes(4), [4]);
    assert_eq!(sizes(5), [2, 3]);
    assert_eq!(sizes(16), [4; 4]);
    for n in 1..=Bands::MOST as u32 {
        let groups = Bands::spectral(n).groups();
        assert_eq!(groups.iter().cloned().flatten().collect::<Vec<_>>(), (0..n as usize).collect::<Vec<_>>());
        assert!(groups.iter().all(|g| (1..=Bands::TOGETHER).contains(&g.len())));
    }
}

#[test]
fn spectral_bands_are_midpoints() {
    assert_eq!(Bands::spectral(4).to_string(), "430 nm, 530 nm, 630 nm, 730 nm");
    assert_eq!(Bands::spectral(16).to_string().split(", ").next(), Some("392.5 nm"));
    assert_eq!(Bands::spectral(1).to_string(), "580 nm");
}

#[test]
fn the_colour_space_of_srgb_has_d65_as_white() {
    let white = apply(&XYZ_FROM_RGB, [1.0; 3]);
    let known = [0.950428545, 1.0, 1.088900371];
    assert!((0..3).all(|c| (white[c] - known[c]).abs() < 1e-8), "{white:?}");
}

#[test]
fn bands_have_their_hue() {
    let weights = list(&[640.0, 540.0, 490.0, 450.0]).display();
    let strongest = |w: [f64; 3]| (0..3).max_by(|a, b| w[*a].total_cmp(&w[*b])).unwrap();
    assert_eq!((strongest(weights[0]), strongest(weights[1]), strongest(weights[3])), (0, 1, 2));
}
