//! Parameters that people write as text, and parameters of operations as JSON.

use super::Outcome;
use ravec::boolean::{Expr, Known};
use ravec_jobs::{
    Recipe, Step, brush, catalogue, compare, complete, match_photos, mesh, mosaic, plane, retarget,
    scenes, twocolor,
};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Display;
use std::str::FromStr;

/// Reads a Boolean expression over meshes.
pub fn read_expression(input: &[u8]) -> Outcome {
    let Ok(text) = std::str::from_utf8(input) else {
        return Outcome::Refused;
    };
    let parsed = Expr::parse(text);
    match &parsed {
        Ok((expr, names)) => {
            assert!(expr.meshes().iter().all(|&mesh| mesh < names.len()));
            let again = Expr::parse_with(text, names).expect("all names are known");
            assert_eq!(&again, expr);
            let flat = expr.clone().flattened();
            // each mesh inside or outside by turns, in a few patterns
            for pattern in [0_usize, usize::MAX, 0x5555, 0x3333, 0x0f0f, 0x9246] {
                let inside = |mesh: usize| pattern >> (mesh % 16) & 1 == 1;
                assert_eq!(
                    expr.eval(&inside),
                    flat.eval(&inside),
                    "flattening changes {text:?}"
                );
                let known = |mesh: usize| if inside(mesh) { Known::In } else { Known::Out };
                let answer = expr.known(&known);
                assert_eq!(
                    answer == Known::In,
                    expr.eval(&inside),
                    "{text:?} is {answer:?}"
                );
            }
        }
        Err(error) => {
            assert!(error.at() <= text.len(), "the place is beyond the text");
            assert!(error.caret(text).contains('^'));
        }
    }
    Outcome::of(&parsed)
}

/// Reads a text as each kind of parameter. The outcome is `Read` if one kind takes it.
pub fn read(input: &[u8]) -> Outcome {
    let Ok(text) = std::str::from_utf8(input) else {
        return Outcome::Refused;
    };
    let taken = [
        shown::<mesh::Length>(text),
        shown::<mesh::Viewpoint>(text),
        shown::<mesh::Cut>(text),
        shown::<retarget::SizeSpec>(text),
        shown::<plane::Quad>(text),
        shown::<plane::Grid>(text),
        shown::<plane::Focal>(text),
        shown::<plane::Ratio>(text),
        shown::<mosaic::Sides>(text),
        text.parse::<plane::rectify::Outside>().is_ok(),
        text.parse::<complete::Corners>().is_ok(),
        stored::<brush::Params>(text),
        stored::<compare::Params>(text),
        stored::<complete::Params>(text),
        stored::<catalogue::CleanParams>(text),
        stored::<match_photos::Params>(text),
        stored::<mesh::convert::Params>(text),
        stored::<mesh::offset::Params>(text),
        stored::<mesh::render::Params>(text),
        stored::<mesh::simplify::Params>(text),
        stored::<mosaic::Params>(text),
        stored::<plane::snap::Params>(text),
        stored::<plane::rectify::Params>(text),
        stored::<retarget::Params>(text),
        stored::<scenes::Params>(text),
        stored::<twocolor::Params>(text),
        stored::<Step>(text),
        stored::<Recipe>(text),
    ];
    if taken.contains(&true) {
        Outcome::Read
    } else {
        Outcome::Refused
    }
}

/// Returns `true` if a text is a value, which must then be shown so that it can be read again.
fn shown<T: FromStr + Display>(text: &str) -> bool {
    let Ok(value) = text.parse::<T>() else {
        return false;
    };
    let shown = value.to_string();
    let again = shown
        .parse::<T>()
        .unwrap_or_else(|_| panic!("{text:?} is shown as {shown:?}, which is no value"));
    assert_eq!(again.to_string(), shown);
    true
}

/// Returns `true` if a text is parameters as JSON, which must then be stored so that they can be read again.
fn stored<T: DeserializeOwned + Serialize>(text: &str) -> bool {
    let Ok(value) = serde_json::from_str::<T>(text) else {
        return false;
    };
    let stored = serde_json::to_string(&value).expect("parameters are plain data");
    let again: T =
        serde_json::from_str(&stored).unwrap_or_else(|error| panic!("{stored}: {error}"));
    assert_eq!(serde_json::to_string(&again).expect("as before"), stored);
    true
}
