//! Letters as strokes: polylines and smooth curves on a grid of 4 × 6 units.
//!
//! Enough for shop signs and line drawings; not a typeface. Each glyph is a list of strokes; each stroke a list of
//! control points, two digits a point (x to the right, y down). A stroke that begins with `~` is the quadratic B-spline
//! of its control points (clamped at its ends), flattened to eight pieces a span.

use glam::DVec2;

/// Width of a letter cell in units of the grid, gap included.
pub(crate) const ADVANCE: f64 = 5.8;
/// Height of a letter in units of the grid.
pub(crate) const HEIGHT: f64 = 6.0;

fn strokes_of(letter: char) -> &'static str {
    match letter {
        'A' => "06 20 46;14 34",
        'B' => "00 06;~00 30 40 43 23 03;~03 23 43 46 30 06;03 23",
        'C' => "~41 30 10 00 02 04 06 16 36 45",
        'D' => "00 06;~00 30 40 46 36 06",
        'E' => "40 00 06 46;03 33",
        'F' => "40 00 06;03 33",
        'G' => "~41 30 10 00 02 04 06 16 46 43;43 23",
        'H' => "00 06;40 46;03 43",
        'I' => "20 26",
        'J' => "~40 44 46 06 04",
        'K' => "00 06;40 03 46",
        'L' => "00 06 46",
        'M' => "06 00 23 40 46",
        'N' => "06 00 46 40",
        'O' => "~20 00 00 06 06 46 46 40 40 20",
        'P' => "06 00;~00 30 40 43 33 03",
        'Q' => "~20 00 00 06 06 46 46 40 40 20;24 46",
        'R' => "06 00;~00 30 40 43 33 03;23 46",
        'S' => "~41 40 00 02 13 33 44 46 06 05",
        'T' => "00 40;20 26",
        'U' => "~00 04 06 46 44 40",
        'V' => "00 26 40",
        'W' => "00 16 22 36 40",
        'X' => "00 46;40 06",
        'Y' => "00 23 40;23 26",
        'Z' => "00 40 06 46",
        '0' => "~20 00 06 26 46 40 20",
        '1' => "01 20 26",
        '2' => "~01 00 40 42 24 06;06 46",
        '3' => "~00 40 43 23;~23 43 46 06 05",
        '4' => "36 30 04 44",
        '5' => "40 00 02;~02 42 46 06 05",
        '6' => "~40 10 04 06 46 43 03 04",
        '7' => "00 40 16",
        '8' => "~20 00 03 23 43 40 20;~23 03 06 26 46 43 23",
        '9' => "~06 36 42 40 00 03 43 42",
        '&' => "~46 11 10 30 32 04 06 26 43",
        '-' => "13 33",
        '.' => "26 26",
        '\'' => "20 21",
        _ => "",
    }
}

/// The polylines of a text in units of the grid, the first letter's cell at the origin, y down.
pub(crate) fn polylines(text: &str) -> Vec<Vec<DVec2>> {
    let mut all = Vec::new();
    for (index, letter) in text.chars().enumerate() {
        let shift = DVec2::new(index as f64 * ADVANCE, 0.0);
        for stroke in strokes_of(letter).split(';').filter(|s| !s.is_empty()) {
            let smooth = stroke.starts_with('~');
            let points: Vec<DVec2> = stroke
                .trim_start_matches('~')
                .split(' ')
                .filter_map(|pair| {
                    let mut digits = pair.chars().filter_map(|c| c.to_digit(10));
                    Some(shift + DVec2::new(f64::from(digits.next()?), f64::from(digits.next()?)))
                })
                .collect();
            all.push(if smooth { spline(&points) } else { points });
        }
    }
    all
}

/// The width of a text in units of the grid, without the gap after the last letter.
pub(crate) fn text_width(text: &str) -> f64 {
    (text.chars().count() as f64 * ADVANCE - (ADVANCE - 4.0)).max(0.0)
}

/// The quadratic B-spline of control points as a polyline: it starts and ends at the outer ones and touches each inner
/// leg at its middle.
pub(crate) fn spline(control: &[DVec2]) -> Vec<DVec2> {
    const PIECES: usize = 8;
    let n = control.len();
    if n < 3 {
        return control.to_vec();
    }
    let mut points = vec![control[0]];
    for i in 1..n - 1 {
        let from = if i == 1 {
            control[0]
        } else {
            control[i - 1].midpoint(control[i])
        };
        let to = if i == n - 2 {
            control[n - 1]
        } else {
            control[i].midpoint(control[i + 1])
        };
        for piece in 1..=PIECES {
            let t = piece as f64 / PIECES as f64;
            let (a, b) = (from.lerp(control[i], t), control[i].lerp(to, t));
            points.push(a.lerp(b, t));
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_and_digit_has_strokes_within_its_cell() {
        for letter in ('A'..='Z').chain('0'..='9') {
            let strokes = polylines(&letter.to_string());
            assert!(!strokes.is_empty(), "{letter}");
            for p in strokes.iter().flatten() {
                assert!(
                    (0.0..=4.0).contains(&p.x) && (0.0..=6.0).contains(&p.y),
                    "{letter} {p}"
                );
            }
        }
        assert!(polylines(" ").is_empty());
    }

    #[test]
    fn splines_keep_their_ends_and_touch_the_middles_of_legs() {
        let control = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (4.0, 2.0)].map(DVec2::from);
        let curve = spline(&control);
        assert_eq!((curve[0], curve[curve.len() - 1]), (control[0], control[3]));
        assert!(curve.contains(&DVec2::new(2.0, 1.0)));
    }
}
