//! Reasons why a result is probably not what was meant.

use super::rule::Rule;
use crate::params::{BooleanReport, CloseRule};

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

/// What to do about a sheet that has to be a solid.
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
