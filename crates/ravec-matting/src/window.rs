//! Largest values of square windows.

use ravec_raster::Plane;

/// Largest value of the square window of `radius` around each pixel.
pub(crate) fn largest_within(plane: &Plane, radius: usize) -> Plane {
    let mut across = plane.clone();
    across.for_each_row(|row, out| {
        let line = plane.row(row);
        for offset in 1..=radius.min(line.len()) {
            raise(&mut out[offset..], line);
            raise(out, &line[offset..]);
        }
    });
    let mut both = across.clone();
    both.for_each_row(|row, out| {
        for other in row.saturating_sub(radius)..(row + radius + 1).min(plane.height()) {
            raise(out, across.row(other));
        }
    });
    both
}

/// Raises values to those of a line.
fn raise(values: &mut [f32], line: &[f32]) {
    for (value, other) in values.iter_mut().zip(line) {
        *value = if *other > *value { *other } else { *value };
    }
}
