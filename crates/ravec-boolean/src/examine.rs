//! Findings about a mesh before it is combined with others.
//!
//! Cost: some tens of nanoseconds a triangle; a search structure over all triangles if a part is inside out.

use glam::DVec3;
use ravec_mesh::{Bvh, OrientedPlane, TriMesh, WindingNumbers};
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

use crate::closing::Closing;
use crate::params::OperandReport;

/// Triangles between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 16;

/// A part with less volume than this share of a cube with its area is a sheet, of which nobody can say what is inside.
const SOLID_REL: f64 = 1e-6;

/// Says what is known about a mesh, except how often it meets itself.
pub(crate) fn examine(
    mesh: &TriMesh,
    closing: &Closing,
    progress: &Progress,
) -> Result<OperandReport, Cancelled> {
    let (reversed, degenerate) = reversed_parts(mesh, closing, progress)?;
    let cancelled = if closing.multiple_edges > 0 {
        progress.check()?;
        cancelled(mesh)
    } else {
        0
    };
    let mut report = OperandReport {
        triangles: mesh.triangles().len() as u64,
        closed: closing.closed,
        oriented: closing.clashing_edges == 0,
        degenerate_triangles: degenerate,
        closing_triangles: closing.triangles.len() as u64,
        reversed_parts: reversed.len() as u64,
        ..OperandReport::default()
    };
    report.assumptions = assumptions(closing, degenerate, cancelled, &reversed);
    Ok(report)
}

/// Triangles of which there is another one that faces the opposite way, which takes away what they enclose.
fn cancelled(mesh: &TriMesh) -> u64 {
    let mut facing: FxHashMap<[u32; 3], [u64; 2]> = FxHashMap::default();
    for &[a, b, c] in mesh.triangles() {
        let mut sorted = [a, b, c];
        sorted.sort_unstable();
        let even = sorted == [a, b, c] || sorted == [b, c, a] || sorted == [c, a, b];
        facing.entry(sorted).or_default()[usize::from(even)] += 1;
    }
    facing.values().map(|[one, other]| 2 * one.min(other)).sum()
}

/// A part that is inside out.
struct Reversed {
    volume: f64,
    /// The middle of one of its triangles.
    at: DVec3,
}

/// A connected part of a mesh: what triangles, those of the closing among them, join by their vertices.
#[derive(Debug, Clone, Copy, Default)]
struct Part {
    volume: f64,
    area: f64,
}

impl Part {
    fn is_negative(&self) -> bool {
        self.volume < -SOLID_REL * self.area.powf(1.5)
    }
}

/// The parts that are inside out, and the number of triangles of the mesh without area.
fn reversed_parts(
    mesh: &TriMesh,
    closing: &Closing,
    progress: &Progress,
) -> Result<(Vec<Reversed>, u64), Cancelled> {
    let all = || mesh.triangles().iter().chain(&closing.triangles);
    let mut group = DisjointSets::new(mesh.positions().len());
    for (i, &[a, b, c]) in all().enumerate() {
        if i.is_multiple_of(STRIDE) {
            progress.check()?;
        }
        group.join(a, b);
        group.join(a, c);
    }
    let origin = mesh.bounds().center();
    let mut parts = vec![Part::default(); group.len()];
    let mut degenerate = 0;
    for (i, t) in all().enumerate() {
        if i.is_multiple_of(STRIDE) {
            progress.check()?;
        }
        let corners = t.map(|v| mesh.positions()[v as usize]);
        let [a, b, c] = corners;
        let plane = OrientedPlane::through(a, b, c);
        degenerate += u64::from(i < mesh.triangles().len() && plane.is_degenerate());
        let [a, b, c] = corners.map(|corner| corner - origin);
        let own = group.root(t[0]);
        let part = &mut parts[own as usize];
        part.volume += a.dot(b.cross(c)) / 6.0;
        part.area += 0.5 * plane.normal().length();
    }
    if !parts.iter().any(Part::is_negative) {
        return Ok((Vec::new(), degenerate));
    }
    join_by_place(mesh, &mut group, &mut parts);
    if !parts.iter().any(Part::is_negative) {
        return Ok((Vec::new(), degenerate));
    }
    // some triangles of each part that is negative
    let mut samples: Vec<Vec<[DVec3; 2]>> = vec![Vec::new(); parts.len()];
    for t in all() {
        let own = group.root(t[0]);
        let samples = &mut samples[own as usize];
        if parts[own as usize].is_negative() && samples.len() < SAMPLES {
            let [a, b, c] = t.map(|v| mesh.positions()[v as usize]);
            // a thousandth of the triangle's size away from it on either side
            let normal = (b - a).cross(c - a);
            let away = 1e-3 * normal.normalize_or_zero() * normal.length().sqrt();
            let middle = (a + b + c) / 3.0;
            samples.push([middle - away, middle + away]);
        }
    }
    let closed = [mesh.triangles(), &closing.triangles].concat();
    let closed = TriMesh::new(mesh.positions().to_vec(), closed);
    let closed = closed.expect("a closing has the vertices of its mesh");
    let bvh = Bvh::try_new(&closed, progress)?;
    let winding = WindingNumbers::try_new(&bvh, progress)?;
    let mut reversed = Vec::new();
    for (part, samples) in parts.iter().zip(samples) {
        progress.check()?;
        // on the surface of a part that winds −1 in itself it winds −½ on average, and what is around it adds to that
        let is_outside =
            |sides: &&[DVec3; 2]| sides.map(|p| winding.at(p)).iter().sum::<f64>() < 0.0;
        let outside = samples.iter().filter(is_outside).count();
        if 2 * outside > samples.len() {
            reversed.push(Reversed {
                volume: part.volume,
                at: samples[0][0],
            });
        }
    }
    reversed.sort_by(|a, b| a.volume.total_cmp(&b.volume));
    Ok((reversed, degenerate))
}

/// Makes parts one of which one is negative and that have a vertex at the same place: specks at a surface belong to it.
fn join_by_place(mesh: &TriMesh, group: &mut DisjointSets, parts: &mut [Part]) {
    let place = |v: u32| {
        let at = mesh.positions()[v as usize].to_array();
        at.map(|x| (x + 0.0).to_bits())
    };
    let vertices = || 0..mesh.positions().len() as u32;
    let mut negative: FxHashMap<[u64; 3], u32> = FxHashMap::default();
    for v in vertices() {
        if parts[group.root(v) as usize].is_negative() {
            negative.entry(place(v)).or_insert(v);
        }
    }
    for v in vertices() {
        let Some(&other) = negative.get(&place(v)) else {
            continue;
        };
        let (a, b) = (group.root(v), group.root(other));
        if a != b {
            let gone = std::mem::take(&mut parts[a.max(b) as usize]);
            let kept = &mut parts[a.min(b) as usize];
            kept.volume += gone.volume;
            kept.area += gone.area;
            group.join(a, b);
        }
    }
}

/// Number of triangles of a part that decide whether it is in another: a few may lie on a border.
const SAMPLES: usize = 5;

/// Assumptions, as sentences without a stop.
fn assumptions(
    closing: &Closing,
    degenerate: u64,
    cancelled: u64,
    reversed: &[Reversed],
) -> Vec<String> {
    let mut notes = Vec::new();
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
    if degenerate > 0 {
        notes.push(format!(
            "{} without area {} left out",
            counted(degenerate, "triangle", "triangles"),
            if degenerate == 1 { "was" } else { "were" }
        ));
    }
    if let Some(largest) = reversed.first() {
        let count = reversed.len() as u64;
        let (verb, largest_is) = if count == 1 {
            ("is", "")
        } else {
            ("are", "the largest ")
        };
        notes.push(format!(
            "{} {verb} inside out ({largest_is}with a volume of {} near {}): only \"nonzero\" and \"outer-hull\" take \
             such parts for solid",
            counted(count, "part", "parts"),
            short(largest.volume),
            place(largest.at)
        ));
    }
    notes
}

fn counted(count: u64, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

fn having(count: u64, one: &str, many: &str) -> String {
    let verb = if count == 1 { "has" } else { "have" };
    format!("{} {verb}", counted(count, one, many))
}

fn place(at: DVec3) -> String {
    format!("({}, {}, {})", short(at.x), short(at.y), short(at.z))
}

/// A number with four digits.
fn short(x: f64) -> String {
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

#[cfg(test)]
mod tests;
