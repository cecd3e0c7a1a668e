use super::*;
use glam::dvec2;
use ravec_raster::Size;
use ravec_scenes::Seed;
use ravec_scenes::edge::{EdgeTruth, TwoColors, edge};
use ravec_scenes::texture::fractal;
use ravec_twocolor::Line;

#[test]
fn a_straight_edge_is_one_run_on_it() {
    let size = Size::new(320, 240).unwrap();
    for degrees in [0, 12, 37, 45, 90, 122, 171] {
        let colors = TwoColors::gray_step(128.0, 64.0);
        let through = dvec2(160.3, 120.7);
        let truth = EdgeTruth::from_angle(f64::from(degrees).to_radians(), through, colors);
        let runs = straight_runs(&edge(size, &truth));
        assert_eq!(runs.len(), 1, "{degrees}");
        let normal = DVec2::from_angle(f64::from(degrees).to_radians());
        for end in runs[0].ends {
            let away = (end - through).dot(normal).abs();
            assert!(away < 0.25, "{degrees}: {end} is {away} away");
        }
        assert!(runs[0].length() > 220.0, "{degrees}: {}", runs[0].length());
    }
}

#[test]
fn small_discs_have_no_straight_runs() {
    let disc = Image::from_fn(Size::new(200, 200).unwrap(), |col, row| {
        let r = (col as f64 - 99.5).hypot(row as f64 - 99.5);
        LinearRgb([if r < 50.0 { 0.1 } else { 0.6 }; 3])
    });
    assert_eq!(straight_runs(&disc), []);
}

#[test]
fn an_edge_is_followed_behind_a_post() {
    let size = Size::new(320, 160).unwrap();
    let truth = EdgeTruth::from_angle(1.4, dvec2(160.0, 80.0), TwoColors::gray_step(128.0, 64.0));
    let mut image = edge(size, &truth);
    for row in 0..160 {
        for col in 150..200 {
            image[(col, row)] = LinearRgb([0.02; 3]);
        }
    }
    let along = straight_runs(&image)
        .into_iter()
        .filter(|run| run.direction().x.abs() > 0.9);
    assert_eq!(along.count(), 1);
}

const ROUGH: [usize; 2] = [640, 420];

/// Gray ground, two fifths lighter and darker by grains of four pixels, and a stroke of a color on it.
fn rough(seed: Seed, stroke: Option<(Line, f64, [f32; 3])>) -> Image<LinearRgb> {
    Image::from_fn(Size::new(ROUGH[0], ROUGH[1]).unwrap(), |col, row| {
        let p = dvec2(col as f64 + 0.5, row as f64 + 0.5);
        let ground = 0.5 * (1.0 + 0.4 * fractal(p / 8.0, 1.0 / 8.0, 3, seed)) as f32;
        let Some((line, width, color)) = stroke else {
            return LinearRgb([ground; 3]);
        };
        let border = |shift: f64| Line {
            normal: line.normal,
            offset_px: line.offset_px + shift * width,
        };
        let share = (border(0.5).coverage(p) - border(-0.5).coverage(p)) as f32;
        LinearRgb(color.map(|v| ground + share * (v - ground)))
    })
}

#[test]
fn a_stroke_on_rough_ground_is_found_all_along() {
    for seed in 0..24 {
        let seed = Seed(seed);
        // the former finder lost those of about a block's width, however strong they were
        let width = seed.between(0, 0, 0, 2.0, 9.0);
        let angle = seed.between(0, 0, 1, 0.0, std::f64::consts::PI);
        let middle = 0.5 * dvec2(ROUGH[0] as f64, ROUGH[1] as f64);
        let through = middle + dvec2(seed.between(0, 0, 2, -80.0, 80.0), 0.0);
        let line = Line::from_angle(angle, DVec2::from_angle(angle).dot(through));
        let color = [[0.3, 0.05, 0.05], [0.1, 0.2, 0.45], [0.15; 3]][seed.0 as usize % 3];
        let runs = straight_runs(&rough(seed, Some((line, width, color))));
        // every place of the stroke has a run at its edge
        let along = line.normal.perp();
        let places: Vec<DVec2> = (-400..400)
            .map(|t| line.normal * line.offset_px + along * (f64::from(t) + along.dot(through)))
            .filter(|p| {
                p.cmpge(DVec2::splat(8.0)).all()
                    && p.x < ROUGH[0] as f64 - 8.0
                    && p.y < ROUGH[1] as f64 - 8.0
            })
            .collect();
        let covered = places
            .iter()
            .filter(|&&p| runs.iter().any(|run| run.distance(p) < 0.5 * width + 1.5));
        let share = covered.count() as f64 / places.len() as f64;
        assert!(
            share > 0.95,
            "{seed:?}, {width:.1} wide: {share:.2} of it is found"
        );
    }
}

#[test]
fn rough_ground_has_no_straight_runs() {
    for seed in 0..12 {
        assert_eq!(straight_runs(&rough(Seed(seed), None)), [], "seed {seed}");
    }
}
