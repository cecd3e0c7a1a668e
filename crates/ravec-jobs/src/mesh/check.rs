//! `mesh check`: the defects of a mesh, and where they are.

use super::compare::short;
use super::{Length, weld};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::Operation;
use crate::report::{Finding, Place, Report};
use glam::DVec3;
use ravec::mesh::{CheckParams, Found, MeshCheck, TriMesh, TriTri, check, measure};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Check a mesh for defects and locate them; the exit code is 1 if there are any
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Check {
    /// Input mesh; `-` is standard input
    pub input: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec mesh check part.stl
  ravec mesh check part.stl --no-intersections --list 3
  ravec mesh check sheet.obj --open --weld 0.001%

Defects, each with its first places: degenerate triangles (without area), duplicate triangles, non-manifold edges (of more \
than two triangles), pinched vertices (whose triangles form more than one fan), orientation clashes (neighbors that face \
opposite sides), boundary loops and edges (but with --open), self-intersections, a surface that is inside out, a mesh without \
triangles. Unused vertices are listed but no defect. Vertices on borders that lie where another one does, as along seams of normals or \
texture coordinates, are joined first (joined_vertices). Vertices and triangles are counted from 0. All is decided by exact \
arithmetic.

Figures: those of info that are counts, euler, and the number of each defect; self_intersections is the sum of pairs that are \
crossing, overlapping within a plane, coincident or touching. In JSON, findings hold all places, passed the verdict, and details the report of the library.";

/// Parameters of [`Check`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Do not search for self-intersections, which takes about half of the time
    #[cfg_attr(feature = "cli", arg(long))]
    pub no_intersections: bool,
    /// Let the surface have borders: they are listed, but are no defect
    #[cfg_attr(feature = "cli", arg(long))]
    pub open: bool,
    /// Maximum number of places of each kind to list; all are counted
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Params::default().list))]
    pub list: usize,
    /// Make vertices one first that are no farther apart than this, a length or as in 0.01%; 0 welds equal places
    ///
    /// Vertices at the same place are two otherwise, unless the file is STL, which cannot say it.
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH"))]
    pub weld: Option<Length>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            no_intersections: false,
            open: false,
            list: 10,
            weld: None,
        }
    }
}

impl Operation for Check {
    const NAME: &'static str = "mesh check";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    /// Searches for the defects that keep the mesh from being the surface of a solid.
    ///
    /// Defects: no triangles at all, boundary edges (unless [`Params::open`]), non-manifold edges, pinched vertices,
    /// orientation clashes, degenerate and duplicate triangles, self-intersections, and a surface that is inside out. Unused
    /// vertices are listed, but are no defect. [`Report::passed`] is true if there is none. Vertices on borders that lie where
    /// another one does are joined first, as along seams of texture coordinates.
    ///
    /// Figures: `triangles`, `vertices`, `edges`, `parts`, `closed`, `manifold`, `oriented`, `euler`, `genus` where there is one,
    /// and the count of each defect; `self_intersections` is the sum of pairs that are `crossing`, `overlapping` within a plane,
    /// `coincident` or `touching`; `joined_vertices`, if there are any. The details are a [`MeshCheck`].
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::ReadMesh`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { input, params } = self;
        let progress = &context.progress;
        weld::check(params.weld)?;
        context.check_files(&self.inputs(), &[])?;
        let mut report = Report::of(self, params);
        let file = super::read(input, &[], &mut report, context)?;
        let mesh = weld::welded(file.mesh, params.weld, file.unit, &mut report, progress)?;
        let joined = weld::seams(&mesh, input, &mut report, progress)?;
        let mesh = joined.as_ref().map_or(&mesh, |joined| &joined.mesh);
        let asked = CheckParams {
            self_intersections: !params.no_intersections,
            list_limit: params.list,
        };
        let phase = progress.phase("check", 1);
        let found = report.time("check", || check(mesh, &asked, progress))?;
        phase.advance(1);
        count(&found, &mut report);
        progress.check()?;
        report.findings = findings(mesh, &found, params);
        if let Some(joined) = &joined {
            let places = report.findings.iter_mut().flat_map(|f| &mut f.places);
            for v in places.flat_map(|place| &mut place.vertices) {
                *v = joined.vertex_of[*v as usize];
            }
        }
        report.verdict.closed = Some(found.closed);
        if found.self_intersections.is_some() {
            report.verdict.solid = Some(is_solid(mesh, &found));
        }
        report.passed = Some(report.findings.iter().all(|finding| !finding.defect));
        Ok(report)
    }
}

/// True for a mesh in which a full check finds no defect: the surface of a solid that faces out.
pub(super) fn is_solid(mesh: &TriMesh, found: &MeshCheck) -> bool {
    found.is_solid()
        && findings(mesh, found, &Params::default())
            .iter()
            .all(|finding| !finding.defect)
}

fn count(found: &MeshCheck, report: &mut Report) {
    let yes = |fact: bool| f64::from(u8::from(fact));
    report.embed(found);
    report.figures.extend([
        ("triangles", found.triangles as f64),
        ("vertices", found.vertices as f64),
        ("edges", found.edges as f64),
        ("parts", f64::from(found.components)),
        ("closed", yes(found.closed)),
        ("manifold", yes(found.manifold)),
        ("oriented", yes(found.oriented)),
        ("euler", found.euler as f64),
        ("boundary_edges", found.boundary_edges.count as f64),
        ("boundary_loops", found.boundary_loops.count as f64),
        ("non_manifold_edges", found.non_manifold_edges.count as f64),
        ("pinched_vertices", found.pinched_vertices.count as f64),
        (
            "orientation_clashes",
            found.orientation_clashes.count as f64,
        ),
        (
            "degenerate_triangles",
            found.degenerate_triangles.count as f64,
        ),
        (
            "duplicate_triangles",
            found.duplicate_triangles.count as f64,
        ),
        ("unused_vertices", found.unused_vertices.count as f64),
    ]);
    if let Some(genus) = found.genus {
        report.figures.insert("genus", genus as f64);
    }
    if let Some(pairs) = &found.self_intersections {
        report.figures.extend([
            ("self_intersections", pairs.count as f64),
            ("crossing", pairs.crossing as f64),
            ("overlapping", pairs.overlapping as f64),
            ("coincident", pairs.coincident as f64),
            ("touching", pairs.touching as f64),
        ]);
    }
}

/// Lists the defects and remarks of a check of `mesh`, in the order in which one would repair them.
///
/// `params` decides which of them count as defects. The places are those that `found` lists.
pub fn findings(mesh: &TriMesh, found: &MeshCheck, params: &Params) -> Vec<Finding> {
    let vertex = |&v: &u32| Place {
        vertices: vec![v],
        at: mesh.positions()[v as usize].to_array(),
        ..Place::default()
    };
    let edge = |&[a, b]: &[u32; 2]| {
        let ends = [a, b].map(|v| mesh.positions()[v as usize]);
        Place {
            vertices: vec![a, b],
            at: (0.5 * (ends[0] + ends[1])).to_array(),
            ..Place::default()
        }
    };
    let middle = |t: u32| mesh.corners(t).iter().sum::<DVec3>() / 3.0;
    let triangle = |&t: &u32| Place {
        triangles: vec![t],
        at: middle(t).to_array(),
        ..Place::default()
    };
    let mut findings = Vec::new();
    let mut add = |what, count, defect, places| {
        if count > 0 {
            findings.push(Finding {
                what,
                count,
                defect,
                places,
            });
        }
    };
    if found.triangles == 0 {
        add("meshes without triangles", 1, true, Vec::new());
    }
    let triangles = |found: &Found<u32>| found.listed.iter().map(triangle).collect();
    let edges = |found: &Found<[u32; 2]>| found.listed.iter().map(edge).collect();
    let f = &found.degenerate_triangles;
    add("degenerate triangles", f.count, true, triangles(f));
    let f = &found.duplicate_triangles;
    add("duplicate triangles", f.count, true, triangles(f));
    let f = &found.non_manifold_edges;
    add("non-manifold edges", f.count, true, edges(f));
    let f = &found.pinched_vertices;
    let places = f.listed.iter().map(vertex).collect();
    add("pinched vertices", f.count, true, places);
    let f = &found.orientation_clashes;
    add("orientation clashes", f.count, true, edges(f));
    let f = &found.boundary_loops;
    let places = f.listed.iter().map(|rim| Place {
        note: Some(format!(
            "{} of {} edges, {} long",
            if rim.closed { "a loop" } else { "a chain" },
            rim.edges,
            short(rim.length)
        )),
        ..vertex(&rim.vertex)
    });
    add("boundary loops", f.count, !params.open, places.collect());
    let f = &found.boundary_edges;
    add("boundary edges", f.count, !params.open, edges(f));
    if let Some(pairs) = &found.self_intersections {
        let places = pairs.pairs.iter().map(|pair| Place {
            triangles: vec![pair.first, pair.second],
            at: (0.5 * (middle(pair.first) + middle(pair.second))).to_array(),
            note: Some(manner(pair.kind).to_owned()),
            ..Place::default()
        });
        let places = places.collect();
        add("self-intersections", pairs.count, true, places);
    }
    let inside_out = found.closed && found.oriented && is_inside_out(mesh);
    add(
        "surfaces that are inside out",
        inside_out.into(),
        true,
        Vec::new(),
    );
    let f = &found.unused_vertices;
    let places = f.listed.iter().map(vertex).collect();
    add("unused vertices", f.count, false, places);
    findings
}

/// True if the volume is negative beyond the rounding of its sum, which for films and needles is larger than what they hold.
fn is_inside_out(mesh: &TriMesh) -> bool {
    let volume = measure(mesh).volume;
    if volume >= 0.0 {
        return false;
    }
    let center = mesh.bounds().center();
    let rounding = |t: u32| {
        let [a, b, c] = mesh.corners(t);
        (b - a).length() * (c - a).length() * (a - center).length()
    };
    let rounding: f64 = (0..mesh.triangles().len() as u32).map(rounding).sum();
    volume < -4.0 * f64::EPSILON * rounding
}

fn manner(kind: TriTri) -> &'static str {
    match kind {
        TriTri::Crossing => "crossing",
        TriTri::CoplanarOverlap => "overlapping",
        TriTri::Same => "coincident",
        _ => "touching",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{MeshTarget, write_mesh_file};
    use ravec::mesh_io::MeshFormat;
    use ravec::progress::Progress;
    use ravec_scenes::Seed;
    use ravec_scenes::solids::{crossing_plates, sheet, soup, torus};

    fn checked(mesh: &TriMesh, params: &Params) -> Report {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let (target, progress) = (MeshTarget::new(MeshFormat::PlyBinary), Progress::none());
        write_mesh_file(&path, mesh, &target, &progress).unwrap();
        let operation = Check {
            input: path,
            params: params.clone(),
        };
        operation.run(&Context::default()).unwrap()
    }

    fn names(report: &Report) -> Vec<&'static str> {
        report.findings.iter().map(|finding| finding.what).collect()
    }

    #[test]
    fn a_solid_passes_and_the_same_inside_out_does_not() {
        let mesh = torus(2.0, 0.5, 24, 12).mesh;
        let report = checked(&mesh, &Params::default());
        assert_eq!((report.passed, names(&report)), (Some(true), vec![]));
        assert_eq!(report.figures["genus"], 1.0);
        assert_eq!(report.details.unwrap()["components"], 1);
        let (positions, mut triangles) = mesh.into_parts();
        for t in &mut triangles {
            t.swap(0, 1);
        }
        let flipped = TriMesh::new(positions, triangles).unwrap();
        let report = checked(&flipped, &Params::default());
        assert_eq!(report.passed, Some(false));
        assert_eq!(names(&report), ["surfaces that are inside out"]);
    }

    #[test]
    fn borders_are_defects_unless_the_surface_may_be_open() {
        let mesh = sheet(1.0, 1.0, 4, 4).mesh;
        let report = checked(&mesh, &Params::default());
        assert_eq!(report.passed, Some(false));
        assert_eq!(names(&report), ["boundary loops", "boundary edges"]);
        let rim = &report.findings[0].places[0];
        assert_eq!(rim.note.as_deref(), Some("a loop of 16 edges, 4 long"));
        let open = Params {
            open: true,
            ..Params::default()
        };
        assert_eq!(checked(&mesh, &open).passed, Some(true));
    }

    #[test]
    fn places_are_listed_up_to_the_limit_and_counted_beyond() {
        let mesh = crossing_plates(1.0).mesh;
        let params = Params {
            open: true,
            list: 1,
            ..Params::default()
        };
        let report = checked(&mesh, &params);
        let crossing = report.findings.last().unwrap();
        assert_eq!(crossing.what, "self-intersections");
        assert!(crossing.count > 1 && crossing.places.len() == 1);
        assert_eq!(crossing.places[0].triangles.len(), 2);
        assert!(crossing.places[0].at.iter().all(|x| x.abs() < 0.5));
        let params = Params {
            no_intersections: true,
            ..params
        };
        let report = checked(&mesh, &params);
        assert_eq!(report.passed, Some(true));
        assert!(!report.figures.contains_key("self_intersections"));
    }

    #[test]
    fn what_was_planted_in_a_soup_is_found() {
        let (solid, planted) = soup(80, Seed(3));
        let report = checked(&solid.mesh, &Params::default());
        // those that repeat a segment have no area either
        let count = planted.segments.len() + planted.points.len();
        assert!(report.figures["degenerate_triangles"] >= count as f64);
        let count = planted.repeated.len() + planted.flipped.len();
        assert!(
            report.figures["coincident"] + report.figures["degenerate_triangles"] >= count as f64
        );
        assert_eq!(report.passed, Some(false));
        for finding in &report.findings {
            let listed = finding.places.len() as u64;
            assert_eq!(listed, finding.count.min(10), "{}", finding.what);
        }
    }

    #[test]
    fn an_empty_mesh_does_not_pass() {
        let report = checked(&TriMesh::default(), &Params::default());
        assert_eq!(report.passed, Some(false));
        assert_eq!(names(&report), ["meshes without triangles"]);
    }

    #[test]
    fn welding_closes_what_only_looks_open() {
        let mesh = torus(2.0, 0.5, 24, 12).mesh;
        let apart = mesh.triangles().iter().flatten();
        let crack = |(at, &v): (usize, &u32)| mesh.positions()[v as usize] + 1e-9 * at as f64;
        let positions: Vec<_> = apart.enumerate().map(crack).collect();
        let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        let mesh = TriMesh::new(positions, triangles.collect()).unwrap();
        assert_eq!(checked(&mesh, &Params::default()).passed, Some(false));
        let params = Params {
            weld: Some(Length::Units(1e-5)),
            ..Params::default()
        };
        let report = checked(&mesh, &params);
        assert_eq!(report.passed, Some(true));
        assert_eq!(report.figures["vertices"], 288.0);
    }
}
