//! Reasons why a result is probably not what was meant.

use std::cmp::Ordering;

use glam::DVec3;
use ravec_mesh::Aabb;
use rustc_hash::FxHashMap;

use super::rule::Rule;
use crate::arrangement::{Pieces, Side};
use crate::examine::{counted, place, short};
use crate::params::{BooleanReport, CloseRule, DroppedPart, Inside};

/// Says for which meshes no place is inside.
pub(super) fn doubt_empty(rule: &Rule, meshes: &[usize], report: &mut BooleanReport) {
    for &mesh in meshes {
        let holds = |cell: u32| rule.holds(mesh, cell);
        if !(0..rule.cells.len() as u32).any(holds) {
            let operand = &mut report.operands[mesh];
            let remedy = if operand.sheet {
                SHEET_REMEDY
            } else {
                "look at it with a check, and set `inside` to outer-hull if its triangles face both ways"
            };
            let doubt = format!("it encloses no volume and counts as nothing: {remedy}");
            operand.doubts.push(doubt);
        }
    }
}

/// Volume of places that are left out, as a share of that of their mesh, from which on they are notable: less than a screw in a
/// machine, more than where a scan folds over.
const NOTABLE_REL: f64 = 1e-4;

/// Number of places that are named one by one.
const MAX_NAMED: usize = 4;

/// Says which places meshes go around clockwise, if they are left out for that.
pub(super) fn doubt_dropped(
    rule: &Rule,
    pieces: &Pieces,
    meshes: &[usize],
    report: &mut BooleanReport,
) {
    if rule.inside != Inside::Positive {
        return;
    }
    for &mesh in meshes {
        let is_negative = |cell: u32| rule.cells.winding(cell)[mesh] < 0;
        if !(0..rule.cells.len() as u32).any(is_negative) {
            continue;
        }
        let operand = &mut report.operands[mesh];
        let mut dropped = enclosed(rule, pieces, is_negative);
        let all = operand.volume.abs();
        dropped.retain(|part| part.volume > NOTABLE_REL * all);
        if dropped.is_empty() {
            continue;
        }
        let named = dropped.iter().take(MAX_NAMED).map(|part| {
            let center = place(DVec3::from_array(part.center));
            format!("a volume of {} near {center}", short(part.volume))
        });
        let named: Vec<String> = named.collect();
        let more = match dropped.len().saturating_sub(MAX_NAMED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        operand.doubts.push(format!(
            "{} of it {} inside out and left out ({}{more}): turn such parts, or set `inside` to nonzero or outer-hull",
            counted(dropped.len() as u64, "part", "parts"),
            if dropped.len() == 1 { "is" } else { "are" },
            named.join(", ")
        ));
        operand.dropped_parts = dropped;
    }
}

/// Sums over a cell.
struct Sums {
    origin: DVec3,
    volume: f64,
    bounds: Aabb,
}

/// The cells for which `asked` is true, the largest first.
fn enclosed(rule: &Rule, pieces: &Pieces, asked: impl Fn(u32) -> bool) -> Vec<DroppedPart> {
    let mut cells: FxHashMap<u32, Sums> = FxHashMap::default();
    for piece in pieces.all() {
        for (side, sign) in [(Side::Front, -1.0), (Side::Back, 1.0)] {
            let Some(cell) = rule.cells.cell(piece, side).filter(|&cell| asked(cell)) else {
                continue;
            };
            let corners = pieces
                .corners(piece)
                .map(|name| pieces.places.rounded(name));
            let sums = cells.entry(cell).or_insert_with(|| Sums {
                origin: corners[0],
                volume: 0.0,
                bounds: Aabb::EMPTY,
            });
            let [a, b, c] = corners.map(|p| p - sums.origin);
            sums.volume += sign * a.dot(b.cross(c)) / 6.0;
            sums.bounds = sums.bounds.union(Aabb::around(corners));
        }
    }
    let mut parts: Vec<DroppedPart> = cells
        .into_values()
        .map(|sums| DroppedPart {
            volume: sums.volume,
            center: sums.bounds.center().to_array(),
        })
        .collect();
    parts.sort_by(|a, b| {
        let centers = || a.center.iter().zip(b.center).map(|(x, y)| x.total_cmp(&y));
        let by_volume = b.volume.total_cmp(&a.volume);
        by_volume.then_with(|| {
            centers()
                .find(|order| order.is_ne())
                .unwrap_or(Ordering::Equal)
        })
    });
    parts
}

/// Remedy for a sheet that has to be a solid.
const SHEET_REMEDY: &str = "it is an open sheet; set `close` to base to put a relief on a flat base, to lid if that surface is meant, or thicken the \
     sheet by an offset first";

/// Volume of a solid below this share of a cube with its area is rounding.
const MIN_VOLUME_REL: f64 = 1e-9;

/// Adds the doubts that sheets and the result itself raise. Meshes that had no effect raise none.
pub(super) fn doubt(report: &mut BooleanReport, named: &[usize], close: CloseRule) {
    let pruned = std::mem::take(&mut report.pruned);
    let used = || {
        named
            .iter()
            .filter(|&&mesh| !pruned.contains(&(mesh as u32)))
    };
    for &mesh in used() {
        let operand = &mut report.operands[mesh];
        let is_closed_unasked = operand.sheet && !operand.trimmed && close == CloseRule::Auto;
        if is_closed_unasked && operand.doubts.is_empty() {
            let doubt = format!(
                "only what is between it and the surface that closes it counts as inside: {SHEET_REMEDY}"
            );
            operand.doubts.push(doubt);
        }
    }
    let sheets = named.iter().filter(|&&mesh| report.operands[mesh].trimmed);
    let in_sheets: u64 = sheets.map(|&mesh| report.operands[mesh].triangles).sum();
    if report.trimmed && report.kept_triangles == in_sheets && report.triangles == in_sheets {
        report
            .doubts
            .push("no mesh reaches the open surface: it came out as it went in".to_owned());
    }
    let is_open = used().any(|&mesh| !report.operands[mesh].closed);
    report.pruned.clone_from(&pruned);
    if report.triangles == 0 && is_open {
        report.doubts.push(
            "the result is empty, and a mesh was open: what closed it may be the reason".to_owned(),
        );
    }
    let is_flat = report.volume <= MIN_VOLUME_REL * report.area.powf(1.5);
    if report.triangles > 0 && !report.trimmed && is_flat {
        report
            .doubts
            .push("the result encloses no volume".to_owned());
    }
}
