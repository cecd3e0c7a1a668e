//! A grid on a plane, as it looks in perspective.
//!
//! Four corners in the picture make a quadrilateral; columns and rows divide it as they would a rectangle seen by a camera.
//! The eye judges such a grid against windows, bricks or tiles, far more exactly than four corners.
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers. Grid coordinates count columns and rows: the
//! corners are (0, 0), (columns, 0), (columns, rows), (0, rows); what lies beyond them is the extended grid.
//!
//! Source: Pavić, Schönefeld and Kobbelt, "Interactive image completion with perspective correction", 2006; dissertation,
//! section 6.2.

use crate::homography::{Homography, HomographyError};
use glam::{DVec2, dvec2};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Columns and rows in a convex quadrilateral.
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::QuadGrid;
///
/// let corners = [dvec2(10.0, 10.0), dvec2(90.0, 25.0), dvec2(90.0, 75.0), dvec2(10.0, 95.0)];
/// let grid = QuadGrid::new(corners, 4, 3)?;
/// assert!(grid.image_from_grid().apply(dvec2(4.0, 3.0)).distance(corners[2]) < 1e-9);
/// // columns get narrower towards the far side
/// let x = |column: f64| grid.image_from_grid().apply(dvec2(column, 0.0)).x;
/// assert!(x(1.0) - x(0.0) > x(4.0) - x(3.0));
/// # Ok::<(), ravec_planar::HomographyError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Plain", into = "Plain")]
pub struct QuadGrid {
    corners: [DVec2; 4],
    columns: u32,
    rows: u32,
    image_from_grid: Homography,
}

/// The form that is written to files.
#[derive(Serialize, Deserialize)]
struct Plain {
    corners: [DVec2; 4],
    columns: u32,
    rows: u32,
}

/// A side of a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// Row 0: corners 0 and 1.
    Top,
    /// The last column: corners 1 and 2.
    Right,
    /// The last row: corners 2 and 3.
    Bottom,
    /// Column 0: corners 3 and 0.
    Left,
}

impl QuadGrid {
    /// The grid in a quadrilateral, with its corners in the order (0, 0), (columns, 0), (columns, rows), (0, rows), in
    /// pixels, x right, y down, pixel centers at half-integers. No column or row counts as one.
    ///
    /// # Errors
    /// As [`Homography::from_unit_square`].
    pub fn new(corners: [DVec2; 4], columns: u32, rows: u32) -> Result<Self, HomographyError> {
        let (columns, rows) = (columns.max(1), rows.max(1));
        let extent = dvec2(f64::from(columns), f64::from(rows));
        let square = Homography::from_unit_square(corners)?;
        Ok(Self {
            corners,
            columns,
            rows,
            image_from_grid: square * Homography::from_scale(extent.recip())?,
        })
    }

    /// The corners in the picture: (0, 0), (columns, 0), (columns, rows), (0, rows), in pixels, x right, y down, pixel
    /// centers at half-integers.
    pub fn corners(&self) -> [DVec2; 4] {
        self.corners
    }

    /// Columns, at least 1.
    pub fn columns(&self) -> u32 {
        self.columns
    }

    /// Rows, at least 1.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// Leads from grid coordinates to pixels (x right, y down, pixel centers at half-integers).
    pub fn image_from_grid(&self) -> Homography {
        self.image_from_grid
    }

    /// The same quadrilateral, divided differently.
    ///
    /// # Errors
    /// None that this grid did not have, but for counts in the millions.
    pub fn divided(&self, columns: u32, rows: u32) -> Result<Self, HomographyError> {
        Self::new(self.corners, columns, rows)
    }

    /// The grid with one corner (0 to 3; more counts on) moved to a place in pixels, x right, y down, pixel centers at
    /// half-integers.
    ///
    /// # Errors
    /// As [`QuadGrid::new`].
    pub fn with_corner(&self, index: usize, at: DVec2) -> Result<Self, HomographyError> {
        let mut corners = self.corners;
        corners[index % 4] = at;
        Self::new(corners, self.columns, self.rows)
    }

    /// The grid with the two corners of a side moved by an offset in pixels.
    ///
    /// # Errors
    /// As [`QuadGrid::new`].
    pub fn with_side_moved(&self, side: Side, offset: DVec2) -> Result<Self, HomographyError> {
        let first = side as usize;
        let mut corners = self.corners;
        corners[first] += offset;
        corners[(first + 1) % 4] += offset;
        Self::new(corners, self.columns, self.rows)
    }

    /// The grid that goes on along the plane: from the first to the last of the given columns and rows, counted as before.
    ///
    /// # Errors
    /// [`HomographyError::HorizonCrosses`] if the plane does not go on that far in the picture, and as [`QuadGrid::new`];
    /// an empty range counts as degenerate.
    pub fn extended(
        &self,
        columns: RangeInclusive<i32>,
        rows: RangeInclusive<i32>,
    ) -> Result<Self, HomographyError> {
        let (left, right, top, bottom) =
            (*columns.start(), *columns.end(), *rows.start(), *rows.end());
        if right <= left || bottom <= top {
            return Err(HomographyError::Degenerate { ratio: 0.0 });
        }
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        let corners = corners.map(|(c, r)| {
            self.image_from_grid
                .try_apply(dvec2(f64::from(c), f64::from(r)))
        });
        let [Some(a), Some(b), Some(c), Some(d)] = corners else {
            return Err(HomographyError::HorizonCrosses);
        };
        Self::new([a, b, c, d], right.abs_diff(left), bottom.abs_diff(top))
    }

    /// The ends of the line between columns `column` − 1 and `column`, from row 0 to the last, in pixels, x right, y down,
    /// pixel centers at half-integers.
    pub fn column_line(&self, column: u32) -> [DVec2; 2] {
        let x = f64::from(column);
        [0.0, f64::from(self.rows)].map(|y| self.image_from_grid.apply(dvec2(x, y)))
    }

    /// The ends of the line between rows `row` − 1 and `row`, from column 0 to the last, in pixels, x right, y down, pixel
    /// centers at half-integers.
    pub fn row_line(&self, row: u32) -> [DVec2; 2] {
        let y = f64::from(row);
        [0.0, f64::from(self.columns)].map(|x| self.image_from_grid.apply(dvec2(x, y)))
    }

    /// The longer diagonal in pixels.
    pub fn diagonal_px(&self) -> f64 {
        let [a, b, c, d] = self.corners;
        a.distance(c).max(b.distance(d))
    }
}

impl TryFrom<Plain> for QuadGrid {
    type Error = HomographyError;

    fn try_from(plain: Plain) -> Result<Self, HomographyError> {
        Self::new(plain.corners, plain.columns, plain.rows)
    }
}

impl From<QuadGrid> for Plain {
    fn from(grid: QuadGrid) -> Self {
        Self {
            corners: grid.corners,
            columns: grid.columns,
            rows: grid.rows,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> QuadGrid {
        let corners = [
            dvec2(100.0, 80.0),
            dvec2(420.0, 110.0),
            dvec2(400.0, 300.0),
            dvec2(90.0, 340.0),
        ];
        QuadGrid::new(corners, 6, 4).unwrap()
    }

    #[test]
    fn an_extended_grid_has_the_same_lines() {
        let (grid, wide) = (grid(), grid().extended(-1..=7, -1..=5).unwrap());
        assert_eq!((wide.columns(), wide.rows()), (8, 6));
        for (c, r) in [(0, 0), (3, 2), (6, 4)].map(|(c, r)| (f64::from(c), f64::from(r))) {
            let (old, new) = (grid.image_from_grid(), wide.image_from_grid());
            assert!(
                old.apply(dvec2(c, r))
                    .distance(new.apply(dvec2(c + 1.0, r + 1.0)))
                    < 1e-9
            );
        }
        assert_eq!(
            grid.extended(-20..=6, 0..=4),
            Err(HomographyError::HorizonCrosses)
        );
        assert!(grid.extended(3..=3, 0..=4).is_err());
    }

    #[test]
    fn lines_end_at_the_sides() {
        let grid = grid();
        let [a, b, c, d] = grid.corners();
        for (line, ends) in [
            (grid.column_line(0), [a, d]),
            (grid.column_line(6), [b, c]),
            (grid.row_line(0), [a, b]),
            (grid.row_line(4), [d, c]),
        ] {
            assert!(line[0].distance(ends[0]) < 1e-9 && line[1].distance(ends[1]) < 1e-9);
        }
    }

    #[test]
    fn corners_and_sides_can_be_moved_but_not_across_each_other() {
        let grid = grid();
        let moved = grid.with_side_moved(Side::Left, dvec2(-10.0, 0.0)).unwrap();
        assert_eq!(moved.corners()[3], grid.corners()[3] - dvec2(10.0, 0.0));
        assert_eq!(moved.corners()[0], grid.corners()[0] - dvec2(10.0, 0.0));
        assert_eq!(moved.corners()[1], grid.corners()[1]);
        assert_eq!(
            grid.with_corner(6, DVec2::ZERO),
            Err(HomographyError::HorizonCrosses)
        );
        assert_eq!(grid.divided(0, 3).unwrap().columns(), 1);
    }
}
