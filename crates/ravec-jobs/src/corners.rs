//! Polygons as parameters.

use crate::error::JobError;
use crate::pixel_centers::PixelCenters;
use glam::DVec2;
use ravec::raster::{Mask, Plane, Rect, Size};
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Corners as they are given on the command line: x and y in turn, in pixels, x right, y down, pixel centers as
/// the parameters around it say. None at all for `none` or an empty text.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Corners(pub Vec<DVec2>);

impl FromStr for Corners {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text.is_empty() || text == "none" {
            return Ok(Self::default());
        }
        let number = |word: &str| match word.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!("`{}` is not a number", word.trim())),
        };
        let numbers = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
        if numbers.len() % 2 == 1 {
            return Err(format!(
                "{} numbers are not pairs of x and y",
                numbers.len()
            ));
        }
        Ok(Self(
            numbers
                .chunks_exact(2)
                .map(|pair| DVec2::new(pair[0], pair[1]))
                .collect(),
        ))
    }
}

/// Refuses polygons of one or two corners.
pub(crate) fn check_polygons(field: &'static str, polygons: &[Corners]) -> Result<(), JobError> {
    match polygons
        .iter()
        .find(|polygon| matches!(polygon.0.len(), 1 | 2))
    {
        Some(polygon) => Err(JobError::Parameter {
            field,
            value: format!("{} corners", polygon.0.len()),
            range: "3 corners or more",
        }),
        None => Ok(()),
    }
}

/// The union of a mask and polygons, each by the exact area of its pixels. Costs the pixels of the polygons' bounding boxes.
pub(crate) fn with_polygons(
    mask: Mask,
    field: &'static str,
    polygons: &[Corners],
    centers: PixelCenters,
) -> Result<Mask, JobError> {
    let size = mask.size();
    let mut coverage = mask.into_coverage();
    for polygon in polygons.iter().filter(|polygon| !polygon.0.is_empty()) {
        let corners: Vec<DVec2> = polygon.0.iter().map(|&at| centers.read(at)).collect();
        let in_range = |at: &DVec2| at.is_finite() && at.abs().max_element() <= MAX_COORDINATE;
        if !corners.iter().all(in_range) {
            return Err(JobError::Parameter {
                field,
                value: "too large".to_owned(),
                range: "coordinates between -1e9 and 1e9",
            });
        }
        add(
            &mut coverage,
            bounding_box(&corners).clipped(size),
            &corners,
        );
    }
    Ok(Mask::from_coverage(&coverage))
}

impl Corners {
    /// True for corners whose bounding box has no pixel of a picture of this size; false without corners.
    pub(crate) fn is_outside(&self, size: Size, centers: PixelCenters) -> bool {
        let corners: Vec<DVec2> = self.0.iter().map(|&at| centers.read(at)).collect();
        !corners.is_empty() && bounding_box(&corners).clipped(size).is_empty()
    }
}

/// The pixels between the extreme coordinates of corners, cut off at column and row 0.
fn bounding_box(corners: &[DVec2]) -> Rect {
    let low = corners.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = corners
        .iter()
        .copied()
        .fold(DVec2::NEG_INFINITY, DVec2::max);
    let (first, end) = (low.max(DVec2::ZERO).floor(), high.max(DVec2::ZERO).ceil());
    Rect::new(
        first.x as usize,
        first.y as usize,
        (end.x - first.x) as usize,
        (end.y - first.y) as usize,
    )
}

/// The largest coordinate of a corner.
const MAX_COORDINATE: f64 = 1e9;

/// Adds the coverage by a polygon in a part of a mask.
fn add(coverage: &mut Plane, part: Rect, corners: &[DVec2]) {
    let Some(size) = part.size() else {
        return;
    };
    let first = DVec2::new(part.col as f64, part.row as f64);
    let corners: Vec<DVec2> = corners.iter().map(|&at| at - first).collect();
    let polygon = Mask::from_polygon(size, &corners).expect("coordinates are in range");
    for row in 0..part.height {
        let old = &mut coverage.row_mut(part.row + row)[part.col..part.right()];
        for (old, &new) in old.iter_mut().zip(polygon.coverage().row(row)) {
            *old = old.max(new);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_cover_what_masks_of_the_whole_picture_do() {
        let size = Size::new(60, 40).unwrap();
        let polygons = [
            "5,5,30,8,20,30",
            "-10,20,25,20,25,90,-10,90",
            "70,5,90,5,80,30",
            "none",
        ];
        let polygons: Vec<Corners> = polygons.iter().map(|text| text.parse().unwrap()).collect();
        let start = Mask::from_disc(size, DVec2::new(40.0, 20.0), 9.0).unwrap();
        let found = with_polygons(start.clone(), "polygons", &polygons, PixelCenters::Half);
        let expected = polygons.iter().fold(start, |mask, polygon| {
            mask.union(&Mask::from_polygon(size, &polygon.0).unwrap())
                .unwrap()
        });
        let found = found.unwrap();
        for row in 0..40 {
            for col in 0..60 {
                let (a, b) = (found.at(col, row), expected.at(col, row));
                assert!((a - b).abs() < 1e-6, "{col} {row}: {a} {b}");
            }
        }
    }
}
