//! Division of a hole into parts that are filled one after another.
//!
//! Pixels on a plane are filled along that plane; the rest is divided into connected components, and components that
//! are spread out, as a net of wires is, into tiles.

use crate::canvas::solid_window;
use glam::DVec2;
use ravec_raster::Mask;

/// Parts of a hole nearer to each other than this are filled together: they share their surroundings.
const NEAR_PX: f64 = 6.0;
/// Parts with a longer side than this are cut, if they fill little of their rectangle.
const LONG_PX: usize = 160;
/// Little is less than this share.
const SPARSE: f64 = 0.25;

/// The pixels of a part, in the order of rows.
pub(crate) type Part = Vec<(usize, usize)>;

/// Returns `true` if a convex quadrilateral contains a position, whichever way round its corners are given.
pub(crate) fn in_quad(quad: &[DVec2; 4], at: DVec2) -> bool {
    let (mut left, mut right) = (false, false);
    for i in 0..4 {
        let side = (quad[(i + 1) % 4] - quad[i]).perp_dot(at - quad[i]);
        left |= side > 0.0;
        right |= side < 0.0;
    }
    !(left && right)
}

/// Takes the pixels of `hole` that lie in a quadrilateral out of it, and returns them.
pub(crate) fn take_quad(hole: &mut Mask, quad: &[DVec2; 4]) -> Part {
    let part: Part = members(hole)
        .filter(|&(col, row)| in_quad(quad, DVec2::new(col as f64 + 0.5, row as f64 + 0.5)))
        .collect();
    let mut rest = hole.coverage().clone();
    for &place in &part {
        rest[place] = 0.0;
    }
    *hole = Mask::from_coverage(&rest);
    part
}

fn members(mask: &Mask) -> impl Iterator<Item = (usize, usize)> {
    let width = mask.size().width();
    let covered = mask
        .coverage()
        .pixels()
        .iter()
        .enumerate()
        .filter(|(_, coverage)| **coverage > 0.0);
    covered.map(move |(index, _)| (index % width, index / width))
}

/// Connected components of a hole, split where they are long and sparse.
pub(crate) fn split(hole: &Mask) -> Vec<Part> {
    let Some((solid, window)) = solid_window(hole, NEAR_PX.ceil() as usize) else {
        return Vec::new();
    };
    let near = solid.dilate(NEAR_PX);
    let (width, height) = (window.width, window.height);
    let mut group = vec![u32::MAX; width * height];
    let mut groups = 0;
    let mut stack = Vec::new();
    for start in 0..width * height {
        if group[start] != u32::MAX || near.coverage().pixels()[start] == 0.0 {
            continue;
        }
        group[start] = groups;
        stack.push(start);
        while let Some(index) = stack.pop() {
            let (col, row) = (index % width, index / width);
            let mut visit = |other: usize| {
                if group[other] == u32::MAX && near.coverage().pixels()[other] > 0.0 {
                    group[other] = groups;
                    stack.push(other);
                }
            };
            if col > 0 {
                visit(index - 1);
            }
            if col + 1 < width {
                visit(index + 1);
            }
            if row > 0 {
                visit(index - width);
            }
            if row + 1 < height {
                visit(index + width);
            }
        }
        groups += 1;
    }
    let mut parts = vec![Part::new(); groups as usize];
    for (col, row) in members(&solid) {
        parts[group[row * width + col] as usize].push((window.col + col, window.row + row));
    }
    parts
        .into_iter()
        .filter(|part| !part.is_empty())
        .flat_map(tiled)
        .collect()
}

/// A part, or its halves and theirs, if it is long and sparse.
fn tiled(part: Part) -> Vec<Part> {
    let low = part.iter().fold((usize::MAX, usize::MAX), |low, p| {
        (low.0.min(p.0), low.1.min(p.1))
    });
    let high = part
        .iter()
        .fold((0, 0), |high, p| (high.0.max(p.0), high.1.max(p.1)));
    let (width, height) = (high.0 - low.0 + 1, high.1 - low.1 + 1);
    if width.max(height) <= LONG_PX || part.len() as f64 >= SPARSE * (width * height) as f64 {
        return vec![part];
    }
    let (first, second): (Part, Part) = part.into_iter().partition(|&(col, row)| {
        if width > height {
            col < low.0 + width / 2
        } else {
            row < low.1 + height / 2
        }
    });
    tiled(first).into_iter().chain(tiled(second)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;
    use ravec_raster::{Rect, Size};

    #[test]
    fn far_parts_are_apart_and_near_ones_together() {
        let size = Size::new(100, 40).unwrap();
        let rect = |col| Mask::from_rect(size, Rect::new(col, 10, 5, 5));
        let hole = rect(10).union(&rect(20)).unwrap().union(&rect(70)).unwrap();
        let parts = split(&hole);
        assert_eq!(parts.iter().map(Vec::len).collect::<Vec<_>>(), [50, 25]);
    }

    #[test]
    fn a_long_wire_is_cut_and_no_pixel_is_lost() {
        let size = Size::new(500, 500).unwrap();
        let hole = Mask::from_fn(size, |col, row| col.abs_diff(row) < 4);
        let parts = split(&hole);
        assert!(parts.len() >= 4);
        let mut all: Vec<_> = parts.concat();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len() as f64, hole.area_px());
    }

    #[test]
    fn a_quad_takes_what_is_in_it_whichever_way_round() {
        let size = Size::new(20, 20).unwrap();
        let quad = [
            dvec2(0.0, 0.0),
            dvec2(10.0, 0.0),
            dvec2(10.0, 20.0),
            dvec2(0.0, 20.0),
        ];
        let turned = [quad[0], quad[3], quad[2], quad[1]];
        for quad in [quad, turned] {
            let mut hole = Mask::full(size);
            assert_eq!(take_quad(&mut hole, &quad).len(), 200);
            assert_eq!(hole.area_px(), 200.0);
        }
    }
}
