//! Findings about a mesh as sentences.

use glam::DVec3;

use super::parts::Parts;
use crate::closing::Closing;

/// Assumptions, as sentences without a stop.
pub(super) fn assumptions(closing: &Closing, parts: &Parts, cancelled: u64) -> Vec<String> {
    let mut notes = Vec::new();
    if parts.is_all_turned {
        notes.push("it is inside out and was turned".to_owned());
    }
    if closing.seam_edges > 0 {
        notes.push(format!(
            "{} whose sides meet only within {} were joined",
            counted(closing.seam_edges, "edge", "edges"),
            short(closing.seam_width)
        ));
    }
    for (bands, one, many, how) in [
        (false, "hole", "holes", "closed by a surface of least area"),
        (
            true,
            "gap between borders",
            "gaps between borders",
            "closed by a band",
        ),
    ] {
        let of_kind = || {
            closing
                .holes
                .iter()
                .filter(|hole| (hole.loops > 1) == bands)
        };
        let widest = of_kind().max_by(|a, b| a.width.total_cmp(&b.width));
        if let Some(widest) = widest {
            let count = of_kind().count() as u64;
            notes.push(format!(
                "{} {} {how}, {}{} across at {}",
                counted(count, one, many),
                if count == 1 { "was" } else { "were" },
                if count == 1 { "" } else { "the widest " },
                short(widest.width),
                place(widest.center)
            ));
        }
    }
    if closing.multiple_edges > 0 {
        notes.push(format!(
            "{} more than two triangles: a place counts as often as the triangles go around it",
            having(closing.multiple_edges, "edge", "edges")
        ));
    }
    if cancelled > 0 {
        notes.push(format!(
            "{cancelled} triangles lie on another one that faces the opposite way: what only these enclose counts as outside, \
             except with \"outer-hull\""
        ));
    }
    if closing.turned_patches > 0 {
        let (verb, them) = if closing.turned_patches == 1 {
            ("faces", "it and was")
        } else {
            ("face", "them and were")
        };
        notes.push(format!(
            "{} {verb} the other way than all around {them} taken as turned",
            counted(
                closing.turned_patches,
                "group of triangles",
                "groups of triangles"
            )
        ));
    } else if closing.clashing_edges > 0 {
        notes.push(format!(
            "{} two triangles that face opposite ways",
            having(closing.clashing_edges, "edge", "edges")
        ));
    }
    let degenerate = parts.degenerate;
    if degenerate > 0 {
        notes.push(format!(
            "{} without area {} left out",
            counted(degenerate, "triangle", "triangles"),
            if degenerate == 1 { "was" } else { "were" }
        ));
    }
    if let Some(largest) = parts.turned.first().filter(|_| !parts.is_all_turned) {
        let count = parts.turned.len() as u64;
        notes.push(format!(
            "{} inside out and touch{} no other, and {} turned ({}with a volume of {} near {})",
            being(count, "part", "parts"),
            if count == 1 { "es" } else { "" },
            if count == 1 { "was" } else { "were" },
            if count == 1 { "" } else { "the largest " },
            short(largest.volume),
            place(largest.center)
        ));
    }
    if let Some(largest) = parts.left.first() {
        let count = parts.left.len() as u64;
        notes.push(format!(
            "{} inside out ({}with a volume of {} near {}): only \"nonzero\" and \"outer-hull\" take such parts for solid",
            being(count, "part", "parts"),
            if count == 1 { "" } else { "the largest " },
            short(largest.volume),
            place(largest.center)
        ));
    }
    notes
}

fn being(count: u64, one: &str, many: &str) -> String {
    let verb = if count == 1 { "is" } else { "are" };
    format!("{} {verb}", counted(count, one, many))
}

pub(crate) fn counted(count: u64, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

fn having(count: u64, one: &str, many: &str) -> String {
    let verb = if count == 1 { "has" } else { "have" };
    format!("{} {verb}", counted(count, one, many))
}

pub(crate) fn place(at: DVec3) -> String {
    format!("({}, {}, {})", short(at.x), short(at.y), short(at.z))
}

/// A number with four digits.
pub(crate) fn short(x: f64) -> String {
    if x == 0.0 || !(1e-3..1e5).contains(&x.abs()) {
        return if x == 0.0 {
            "0".to_owned()
        } else {
            format!("{x:.3e}")
        };
    }
    let before = x.abs().log10().floor() as i32;
    let decimals = (3 - before).max(0) as usize;
    let text = format!("{x:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}
