//! Pictures seen through homographies, of the device and of the CPU.

use crate::gpu;
use crate::pictures::{glass, scenes};
use glam::{DMat3, dvec2};
use ravec_gpu::warp_homography;
use ravec_planar::{Beyond, Homography, warp};
use ravec_progress::Progress;
use ravec_raster::{Image, PremulLinearRgba, Size};

fn maps(size: Size) -> Vec<(&'static str, Homography)> {
    let (w, h) = (size.width() as f64, size.height() as f64);
    let corners = [dvec2(0.0, 0.0), dvec2(w, 0.0), dvec2(w, h), dvec2(0.0, h)];
    let quad = |q: [[f64; 2]; 4]| {
        Homography::from_pairs(&corners, &q.map(|[x, y]| dvec2(x * w, y * h))).unwrap()
    };
    vec![
        (
            "identity",
            Homography::from_translation(dvec2(0.0, 0.0)).unwrap(),
        ),
        (
            "shift",
            Homography::from_translation(dvec2(7.0, -3.0)).unwrap(),
        ),
        (
            "part of a pixel",
            Homography::from_translation(dvec2(-5.3, 4.7)).unwrap(),
        ),
        (
            "enlarged",
            Homography::from_scale(dvec2(0.31, 0.27)).unwrap(),
        ),
        ("reduced", Homography::from_scale(dvec2(2.3, 1.7)).unwrap()),
        (
            "much reduced",
            Homography::from_scale(dvec2(19.0, 23.0)).unwrap(),
        ),
        (
            "tilted",
            quad([[0.1, 0.2], [0.8, 0.0], [0.9, 1.0], [0.2, 0.7]]),
        ),
        (
            "beyond the border",
            quad([[-0.6, -0.4], [1.5, 0.2], [1.2, 1.6], [0.1, 0.9]]),
        ),
        (
            "with a horizon",
            Homography::from_matrix(DMat3::from_cols_array(&[
                1.0, 0.2, 0.0, 0.1, 1.0, 0.02, 0.0, 0.0, -1.0,
            ]))
            .unwrap(),
        ),
    ]
}

fn assert_near(name: &str, image: &Image<PremulLinearRgba>, map: &Homography, size: Size) {
    let Some(gpu) = gpu() else { return };
    for beyond in [
        Beyond::Border,
        Beyond::Pixel(PremulLinearRgba([0.2, 0.1, 0.0, 0.5])),
    ] {
        let on_cpu = warp(image, map, size, beyond, &Progress::none()).unwrap();
        let on_gpu = warp_homography(gpu, image, map, size, beyond, &Progress::none()).unwrap();
        assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
        let pairs = on_cpu.pixels().iter().zip(on_gpu.pixels()).enumerate();
        let mut differences: Vec<f32> = pairs
            .filter(|(index, _)| {
                let (col, row) = (index % size.width(), index / size.width());
                let at = dvec2(col as f64 + 0.5, row as f64 + 0.5);
                // at the horizon a pixel sees tens of thousands; the software driver ends loops after 65 536 rounds
                map.try_apply(at).is_none() || map.jacobian(at).determinant().abs() < 1000.0
            })
            .map(|(_, (a, b))| (0..4).map(|c| (a.0[c] - b.0[c]).abs()).fold(0.0, f32::max))
            .collect();
        differences.sort_by(f32::total_cmp);
        let [most, largest] =
            [998, 1000].map(|share| differences[(differences.len() - 1) * share / 1000]);
        assert!(most <= 2e-3, "{name} {beyond:?}: {most}");
        // where the number of halvings differs
        assert!(largest <= 0.1, "{name} {beyond:?}: {largest}");
    }
}

#[test]
fn scenes_and_glass_through_all_kinds_of_maps() {
    let (_, street) = scenes(101, 73).next().unwrap();
    for image in [street.convert(), glass(101, 73).convert()] {
        for (name, map) in maps(image.size()) {
            for (width, height) in [(101, 73), (45, 58)] {
                assert_near(name, &image, &map, Size::new(width, height).unwrap());
            }
        }
    }
}

#[test]
fn far_from_the_corner_a_shift_is_as_exact_as_near_it() {
    let image = Image::from_fn(Size::new(9000, 24).unwrap(), |col, row| {
        let v = ((col * 37 + row * 91) % 101) as f32 / 100.0;
        PremulLinearRgba([v, 1.0 - v, 0.5 * v, 1.0])
    });
    let map = Homography::from_translation(dvec2(1.37, 0.61)).unwrap();
    assert_near("shift", &image, &map, image.size());
}
