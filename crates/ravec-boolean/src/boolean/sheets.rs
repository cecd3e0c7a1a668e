//! Open sheets, trimmed instead of closed.
//!
//! A sheet encloses nothing, but the winding numbers of solids are known on both sides of each of its pieces. Where the result can
//! lie in sheets alone, as in sheet - solid, pieces are kept by these, and the result is open.

use ravec_progress::Progress;

use super::doubts::{doubt_dropped, doubt_empty};
use super::inputs::Inputs;
use super::rule::Rule;
use super::{Surface, count_contacts, finished, within_memory};
use crate::arrangement::{Cells, cut};
use crate::closing::Closing;
use crate::expr::{Expr, Known};
use crate::params::{BooleanError, BooleanParams, BooleanReport, CloseRule, Inside, OpenRule};
use crate::repair::{conflicts, round_to};
use crate::select::trim;

/// The open meshes that are trimmed, if the result lies in them alone; what closed them is taken back. Sheets that are closed are a
/// doubt.
pub(super) fn sheets_to_trim(
    expr: &Expr,
    params: &BooleanParams,
    inputs: &mut Inputs,
    report: &mut BooleanReport,
) -> Result<Vec<usize>, BooleanError> {
    let named = expr.meshes();
    let is_candidate = |mesh: &usize| {
        let operand = &report.operands[*mesh];
        match params.open {
            OpenRule::Auto => operand.sheet && params.close == CloseRule::Auto,
            OpenRule::Trim => !operand.closed,
            OpenRule::Close => false,
        }
    };
    let candidates: Vec<usize> = named.iter().copied().filter(is_candidate).collect();
    let without_them = expr.known(&|mesh| {
        if candidates.contains(&mesh) {
            Known::Out
        } else {
            Known::Unknown
        }
    });
    // something else has to trim them
    let are_some = !candidates.is_empty() && candidates.len() < named.len();
    let lies_in_them = are_some && without_them == Known::Out;
    if params.open == OpenRule::Trim && !lies_in_them {
        return Err(BooleanError::NothingToTrim);
    }
    if !lies_in_them {
        return Ok(Vec::new());
    }
    for &mesh in &candidates {
        inputs.closings[mesh] = Closing::default();
        let operand = &mut report.operands[mesh];
        operand.trimmed = true;
        operand.closing_triangles = 0;
        operand.volume = 0.0;
        operand.assumptions = vec!["it is an open surface: it was trimmed, not closed, and the result is open, too; set `open` to close to close it first".to_owned()];
        operand.doubts.clear();
    }
    Ok(candidates)
}

/// Cuts sheets along all others and keeps the pieces for which the expression holds, if their sheet is taken for all of space. A
/// piece in the surface of a solid counts as in the solid.
pub(super) fn trim_sheets(
    inputs: &Inputs,
    expr: &Expr,
    sheets: &[usize],
    params: &BooleanParams,
    report: &mut BooleanReport,
    progress: &Progress,
) -> Result<Surface, BooleanError> {
    report.trimmed = true;
    let soup = inputs.soup(progress)?;
    let tree = soup.tree(progress)?;
    let mut draft = {
        let pieces = cut(&soup, &tree, None, progress)?;
        let contacts = pieces.contacts.len() as u64;
        within_memory(soup.triangles.len() as u64, contacts, params)?;
        count_contacts(&pieces, report);
        let hulls = params.inside == Inside::OuterHull;
        let cells = Cells::of(&pieces, &tree, hulls, progress)?;
        let rule = Rule::new(&cells, inputs.meshes.len(), params.inside);
        let solids: Vec<usize> = expr
            .meshes()
            .into_iter()
            .filter(|m| !sheets.contains(m))
            .collect();
        doubt_empty(&rule, &solids, report);
        doubt_dropped(&rule, &pieces, &solids, report);
        let stays = |own: u32, sides: [u32; 2]| {
            expr.eval(&|mesh| {
                mesh == own as usize
                    || (!sheets.contains(&mesh) && sides.iter().any(|&cell| rule.holds(mesh, cell)))
            })
        };
        let is_sheet = |mesh: u32| sheets.contains(&(mesh as usize));
        trim(&pieces, &cells, is_sheet, stays, progress)?
    };
    report.rounded = round_to(&mut draft, params.coordinates);
    report.self_intersections = conflicts(&draft, &tree, progress)?.len() as u64;
    let (parents, finished) = finished(draft, &soup, progress)?;
    Ok(Surface {
        soup,
        parents,
        finished,
    })
}
