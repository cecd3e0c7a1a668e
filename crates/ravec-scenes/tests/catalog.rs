//! Properties of every scene of the catalogue.

use ravec_raster::{LinearRgba, Size};
use ravec_scenes::Seed;
use ravec_scenes::catalog::{SceneId, Truth, render};

fn size(width: usize, height: usize) -> Size {
    Size::new(width, height).unwrap()
}

#[test]
fn every_scene_draws_at_any_small_size_with_finite_light_between_0_and_1() {
    for id in SceneId::ALL {
        for (width, height) in [(1, 1), (1, 7), (9, 1), (2, 2), (13, 5), (31, 47)] {
            for seed in [0, u64::MAX] {
                let scene = render(id, size(width, height), Seed(seed));
                assert_eq!(scene.image.size(), size(width, height));
                for LinearRgba(rgba) in scene.image.convert::<LinearRgba>().pixels() {
                    // colors mixed by coverage may round past the end by a unit in the last place
                    assert!(
                        rgba.iter().all(|v| (0.0..=1.000_001).contains(v)),
                        "{id:?} {rgba:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn every_scene_is_the_same_on_one_thread_and_on_many() {
    let pool = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
    };
    let (one, many) = (pool(1), pool(5));
    for id in SceneId::ALL {
        let draw = || render(id, size(70, 45), Seed(3));
        assert_eq!(one.install(draw), many.install(draw), "{id:?}");
    }
}

#[test]
fn another_seed_draws_another_picture() {
    for id in SceneId::ALL {
        let draw = |seed| render(id, size(64, 48), Seed(seed)).image;
        assert_ne!(draw(1), draw(2), "{id:?}");
    }
}

#[test]
fn truth_survives_as_data() {
    for id in SceneId::ALL {
        let truth = render(id, size(24, 16), Seed(1)).truth;
        let text = serde_json::to_string(&truth).unwrap();
        let back: Truth = serde_json::from_str(&text).unwrap();
        // the text holds the shortest digits that give the same number back
        assert_eq!(serde_json::to_string(&back).unwrap(), text, "{id:?}");
    }
}

#[test]
fn names_are_unique_and_lead_back() {
    for id in SceneId::ALL {
        assert_eq!(SceneId::from_name(id.name()), Some(id));
        assert_eq!(serde_json::to_value(id).unwrap(), id.name());
        assert!(!id.description().is_empty());
        assert!(id.default_size().pixels() > 0);
    }
    assert_eq!(SceneId::from_name("nothing"), None);
}
