//! Parameters of mosaics.

use super::*;
use crate::ErrorKind;

#[test]
fn sides_are_one_number_or_two() {
    let sides = |text: &str| text.parse::<Sides>();
    assert_eq!(
        sides("80x60"),
        Ok(Sides {
            across: 80,
            down: Some(60)
        })
    );
    assert_eq!(sides("80").unwrap().to_string(), "80");
    for wrong in ["", "x", "0", "80x", "80x0", "-3", "3x4x5", "70000"] {
        assert_eq!(sides(wrong), Err(SidesError), "{wrong}");
    }
}

#[test]
fn parameters_out_of_range_are_refused() {
    for params in [
        Params {
            max_uses: Some(0),
            ..Params::default()
        },
        Params {
            degree: 6,
            ..Params::default()
        },
        Params {
            blend: f64::NAN,
            ..Params::default()
        },
        Params {
            detail: 1.5,
            ..Params::default()
        },
        Params {
            min_repeat_distance: -1.0,
            ..Params::default()
        },
        Params {
            feature_degree: Some(6),
            ..Params::default()
        },
        Params {
            feature_weight: 0.0,
            ..Params::default()
        },
        Params {
            rounds: 101,
            ..Params::default()
        },
        Params {
            tiling_rounds: Some(101),
            ..Params::default()
        },
        Params {
            quality: 0,
            ..Params::default()
        },
    ] {
        assert_eq!(checked(&params).unwrap_err().kind(), ErrorKind::Request);
    }
}
