//! `offset`: the surface at a distance from a mesh, closed and proved to be within a tolerance.

mod walls;

use super::convert::{Content, Output, Start, rounds, scale_to_meters, scaled};
use super::files::{CONVERT_FIRST, record_unit_loss};
use super::{Length, weld};
use crate::context::Context;
use crate::error::JobError;
use crate::files::is_stream;
use crate::operation::Operation;
use crate::report::{Finding, Report};
use bytesize::ByteSize;
use ravec::boolean::{BooleanParams, Inside};
use ravec::mesh::{CheckParams, TriMesh, check, join_seams, measure};
use ravec::mesh_io::{LengthUnit, MeshFile};
use ravec::offset::{self as library, OffsetError, OffsetParams, OpenRule, Side};
use ravec::progress::{Cancelled, Progress};
use ravec_files::scratch_file;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Compute the surface at a distance from any triangles, closed and proved to lie within a tolerance
///
/// The exit code is 5 if the result was written but the proof failed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Offset {
    /// Input mesh; `-` is standard input
    pub input: PathBuf,
    /// Output mesh; its extension selects the format, `-` is standard output in the input's format
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec offset part.stl -o grown.stl --distance 2% --side outer
  ravec offset part.stl -o hollow.3mf --distance 0.2mm --unit mm --side shell
  ravec offset other.ply -o around.ply --distance 5% --tolerance 0.5% --no-simplify
  ravec offset part.stl -o smaller.ply --distance=-1% --side inner -q --json smaller.json

The mesh may be any triangles: open, crossing, flipped, doubled. Only inner and shell need a closed one. Edges and corners that \
the offset has are sharp in the result. A triangle is proved if none of its points is nearer to the mesh than the distance less \
the tolerance, nor farther than their sum; the result is solid if it is closed, manifold and does not meet itself. If any of \
that fails, the result is written all the same, a warning says what is wrong, and the exit code is 5. Where coordinates become \
32-bit floats (STL, glTF), all this holds for the mesh in the file.

Bodies that overlap, contain one another or cross themselves have walls inside the solid. Inner and shell measure to the boundary \
of what is inside, as `ravec boolean union` makes it by the same --inside, and a warning says so. Parts that are inside out enclose \
nothing by --inside positive; a warning counts them, and --inside nonzero keeps them.

A length with a unit, as in 2mm, needs a file that names its own (3MF, glTF) or --unit.

Figures: distance, tolerance and diagonal (that of the bounding box), in units of the file that is written; certified and solid (0 or 1), \
uncertified_triangles, self_intersections; distance_least and distance_most, which are proved for every point of the surface, and \
distance_most_found, the most at corners and middles of its triangles; triangles, extracted_triangles (before they were merged), \
feature_edges (where the surface turns by more than 20 degrees); cells and deepest_level of the octree, the tiles it was grown in, repair_rounds, \
split_cells and filled_corners (repairs done in it); crossing_pairs, buried_parts and reversed_parts, where walls inside were removed. In JSON, passed is the verdict, and details the report of the library.";

/// Parameters of [`Offset`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Distance from the mesh: 0.5 (units of the file), 2% (of the diagonal of its bounding box) or 2mm (um, mm, cm, m, in, ft)
    ///
    /// Above 0; with --side inner and shell also below, which is the same, and with --open thicken, which takes the other side.
    #[cfg_attr(
        feature = "cli",
        arg(short, long, value_name = "LENGTH", allow_hyphen_values = true)
    )]
    pub distance: Length,
    /// Maximum error of the distance at any point, a length like that, below half of it
    /// [default: a twentieth of the distance, at most 0.1% of the diagonal or of the distance, whichever is larger]
    ///
    /// Less gives more triangles and takes longer, both about in inverse proportion.
    #[cfg_attr(
        feature = "cli",
        arg(short, long, value_name = "LENGTH", allow_hyphen_values = true)
    )]
    pub tolerance: Option<Length>,
    /// Part of the surface at the distance
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "SIDE", default_value_t = Params::default().side))]
    pub side: Side,
    /// The places that count as inside, with --side inner and shell: where bodies of the mesh overlap, contain one another or
    /// cross themselves, the distance is measured to the boundary of these places
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "RULE", default_value_t = Params::default().inside))]
    pub inside: Inside,
    /// Treatment of a mesh that is not closed: thicken makes a solid of a sheet, with the sheet itself as one skin, its
    /// offset as the other, and upright walls along its boundary
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "RULE", default_value_t = Params::default().open))]
    pub open: OpenRule,
    /// Keep all triangles, rather than merge them as far as the tolerance allows: faster, and many more triangles
    #[cfg_attr(feature = "cli", arg(long))]
    pub no_simplify: bool,
    /// Maximum angle between a merged triangle and the surface that it approximates, above 0, up to 90 degrees [default: 4, and
    /// more where the tolerance is over a twentieth of the distance, and for rough meshes such as scans]
    ///
    /// Less keeps more triangles and looks smoother. A limit that is asked for is that of rough meshes, too. At creases,
    /// triangles that were off more before stay so.
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEGREES"))]
    pub max_normal_deviation: Option<f64>,
    /// Memory limit, such as 2GiB [default: none]
    ///
    /// With less, space is cut into more tiles, which takes longer and gives the same surface; one that is too large is kept in
    /// a temporary file beside the output, some 180 bytes for each triangle before these are merged. The mesh itself stays in
    /// memory.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SIZE"))]
    pub memory: Option<ByteSize>,
    /// Unit of the input's coordinates, whatever the file says; most formats say nothing
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "UNIT"))]
    pub unit: Option<LengthUnit>,
    /// Format of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub output: Output,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            distance: Length::Percent(2.0),
            tolerance: None,
            side: Side::default(),
            inside: Inside::default(),
            open: OpenRule::default(),
            no_simplify: false,
            max_normal_deviation: None,
            memory: None,
            unit: None,
            output: Output::default(),
        }
    }
}

/// The default tolerance as a share of the distance, and the most of it as a share of the diagonal or, where that is
/// larger, of the distance.
///
/// At a twentieth, the eye takes rounded parts for smooth; a thousandth of the diagonal is less than a pixel of most pictures.
const DEFAULT_TOLERANCE: [f64; 2] = [0.05, 1e-3];

/// The tolerance of a draft as a share of the distance. A larger one saves nothing: cells are as large as the distance allows.
const DRAFT_TOLERANCE: f64 = 0.2;

impl Params {
    fn check(&self) -> Result<(), JobError> {
        let wrong = |field, value: Length, range| {
            let value = value.to_string();
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        let distance = self.distance.number();
        let thickens = self.open == OpenRule::Thicken;
        if distance == 0.0 || distance < 0.0 && !self.side.is_inward() && !thickens {
            let range = "above 0: `side` both offsets an open mesh to both sides, and `side` inner or shell a closed \
                         one inward (only there and with `open` thicken it may be below 0)";
            return wrong("distance", self.distance, range);
        }
        let ranges = OffsetParams {
            max_normal_deviation_deg: self.max_normal_deviation,
            ..OffsetParams::default()
        };
        if let Err(OffsetError::NormalDeviation { got }) = ranges.check_ranges() {
            return Err(JobError::Parameter {
                field: "max_normal_deviation",
                value: got.to_string(),
                range: "above 0, up to 90",
            });
        }
        match self.tolerance {
            Some(tolerance) if tolerance.number() <= 0.0 => {
                wrong("tolerance", tolerance, "above 0")
            }
            _ => Ok(()),
        }
    }

    /// Distance and tolerance in units of a mesh.
    fn of(&self, diagonal: f64, unit: Option<LengthUnit>) -> Result<[f64; 2], JobError> {
        let resolve = |field, length: Length| {
            let length = length.resolve(field, diagonal, unit);
            length.map_err(|error| match error {
                JobError::Parameter { field, value, .. } => JobError::Parameter {
                    field,
                    value,
                    range: "a plain number or a percentage: the file does not name its unit (unless `unit` does)",
                },
                other => other,
            })
        };
        let distance = resolve("distance", self.distance.abs())?;
        let [of_distance, of_diagonal] = DEFAULT_TOLERANCE;
        let tolerance = match self.tolerance {
            Some(tolerance) => resolve("tolerance", tolerance)?,
            None => (of_distance * distance).min(of_diagonal * diagonal.max(distance)),
        };
        Ok([distance, tolerance])
    }
}

impl Params {
    /// The parameters of the library for a distance and a tolerance in units of the mesh.
    fn of_library(&self, [distance, tolerance]: [f64; 2]) -> OffsetParams {
        let turns = self.open == OpenRule::Thicken && self.distance.number() < 0.0;
        OffsetParams {
            distance: if turns { -distance } else { distance },
            tolerance,
            side: self.side,
            open: self.open,
            simplify: !self.no_simplify,
            max_normal_deviation_deg: self.max_normal_deviation,
            coordinates: library::Coordinates::Double,
            memory_bytes: self.memory.map(|size| size.as_u64()),
        }
    }
}

/// A mesh prepared for drafts of its offsets: surfaces that are shown while a distance is chosen.
#[derive(Debug)]
pub struct Drafts {
    of_mesh: library::OffsetDrafts,
    diagonal: f64,
    unit: Option<LengthUnit>,
}

impl Drafts {
    /// Prepares drafts of the offsets of a mesh. One that is closed and inside out is turned.
    ///
    /// # Errors
    /// [`OffsetError::NoTriangles`], [`OffsetError::Cancelled`].
    pub fn new(file: &MeshFile, progress: &Progress) -> Result<Self, OffsetError> {
        let joined = join_seams(&file.mesh, progress)?;
        let mesh = joined.as_ref().map_or(&file.mesh, |joined| &joined.mesh);
        let turned = turned(mesh, progress).map_err(|_| Cancelled)?;
        let mesh = turned.as_ref().unwrap_or(mesh);
        Ok(Self {
            of_mesh: library::OffsetDrafts::new(mesh, progress)?,
            diagonal: file.mesh.bounds().diagonal(),
            unit: file.unit,
        })
    }

    /// True for offsets that have drafts: not shells and thickened sheets.
    pub fn cover(params: &Params) -> bool {
        library::OffsetDrafts::covers(&params.of_library([1.0; 2]))
    }

    /// A surface as [`Offset`] makes it, with a fifth of the distance as its tolerance, before proofs, repair and
    /// simplification; nothing for what is refused, and for what would take too long for a draft.
    ///
    /// # Panics
    /// If such an offset has no drafts: see [`Self::cover`].
    pub fn draft(&self, params: &Params, progress: &Progress) -> Option<TriMesh> {
        params.check().ok()?;
        let lengths = params.of(self.diagonal, params.unit.or(self.unit));
        let [distance, _] = lengths.ok()?;
        let params = params.of_library([distance, DRAFT_TOLERANCE * distance]);
        self.of_mesh.draft(&params, progress).ok()?
    }
}

impl Operation for Offset {
    const NAME: &'static str = "offset";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Writes the surface at a distance from the mesh.
    ///
    /// The mesh may be any triangles; [`Side::Inner`] and [`Side::Shell`] need a closed one, and take the boundary of what is
    /// [`inside`](Params::inside) for it if some of its triangles are elsewhere. If a closed mesh is inside out it is turned. If the output holds 32-bit floats, vertices are put on such numbers before anything is decided about their
    /// triangles: all that is said holds for the mesh in the file.
    ///
    /// [`Report::passed`] says whether the result is what was promised: each triangle is proved to keep the distance within the
    /// tolerance, and all of them are the surface of a solid, closed, manifold and without self-intersections. If not, it is
    /// written all the same; a warning and findings say what is wrong with it.
    ///
    /// Figures: `distance`, `tolerance`, `diagonal` (units of the file that is written), `certified` and `solid` (0 or 1),
    /// `uncertified_triangles`, `self_intersections`, `triangles`, `extracted_triangles` (before they were merged); `cells` and
    /// `deepest_level` of the octree, and its repair: `repair_rounds`, `split_cells`, `filled_corners`; `feature_edges`,
    /// where the surface turns by more than 20°; `distance_least` and `distance_most`, proved for every point of the surface, and
    /// `distance_most_found`, the most that a corner or a middle of a triangle has; `crossing_pairs`, `buried_parts` and
    /// `reversed_parts`, if walls inside were removed; `sheet_kept` (0 or 1) of a sheet that was
    /// thickened. The details are an [`OffsetReport`](library::OffsetReport).
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::UnknownMeshFormat`], [`JobError::ReadMesh`], [`JobError::NoTriangles`],
    /// [`JobError::Boolean`], [`JobError::Offset`], [`JobError::WriteMesh`], what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            params,
        } = self;
        let progress = &context.progress;
        params.check()?;
        let report = Report::of(self, params);
        let start = params
            .output
            .start(report, input, output, Content::Shape, context)?;
        let Start {
            mut report,
            file,
            mut target,
        } = start;
        if file.mesh.triangles().is_empty() {
            return Err(JobError::NoTriangles {
                path: input.clone(),
            });
        }
        if let Some(unit) = params.unit {
            target.unit = Some(unit);
        }
        let mut mesh = weld::with_joined_seams(file.mesh, input, &mut report, progress)?;
        let diagonal = mesh.bounds().diagonal();
        let lengths = params.of(diagonal, target.unit)?;
        // rounding depends on the unit: what is judged has to be what is written
        if params.unit.is_none() {
            record_unit_loss(input, output, &target, CONVERT_FIRST, &mut report, context);
        }
        let scale = scale_to_meters(target);
        if let Some(scale) = scale {
            mesh = scaled(mesh, scale, input)?;
            target.unit = Some(LengthUnit::Meter);
        }
        let in_file = |length: f64| scale.map_or(length, |scale| scale.apply(length));
        let [distance, tolerance] = lengths.map(in_file);
        report.figures.extend([
            ("diagonal", in_file(diagonal)),
            ("distance", distance),
            ("tolerance", tolerance),
        ]);
        let asked = OffsetParams {
            coordinates: if rounds(&target) {
                library::Coordinates::Single
            } else {
                library::Coordinates::Double
            },
            ..params.of_library([distance, tolerance])
        };
        if params.side != Side::Both
            && let Some(turned) = turned(&mesh, progress)?
        {
            mesh = turned;
            report.record_assumed(format!(
                "{}: the mesh is inside out and was turned",
                input.display()
            ));
        }
        let mut is_doubtful = false;
        if params.side.is_inward() {
            let rule = BooleanParams {
                inside: params.inside,
                memory_bytes: asked.memory_bytes,
                coordinates: asked.coordinates,
                ..BooleanParams::default()
            };
            let resolved = walls::without_walls(&mesh, input, &rule, &mut report, progress)?;
            if let Some(resolved) = resolved {
                mesh = resolved.mesh;
                is_doubtful = resolved.is_doubtful;
            }
        }
        let beside = Some(output.as_path())
            .filter(|path| !is_stream(path) && !context.is_intermediate(path));
        let storage = || Ok(Box::new(scratch_file(beside)?) as Box<dyn library::Storage>);
        let offset = report.time("offset", || match &context.cluster {
            Some(cluster) => library::offset_in_pieces(&mesh, &asked, &storage, cluster, progress),
            None => library::offset_stored(&mesh, &asked, &storage, progress),
        });
        let library::StoredOffset {
            surface,
            report: done,
        } = offset.map_err(|cause| JobError::from_offset(input, cause))?;
        drop(mesh);
        record(&done, params.side, &mut report);
        if is_doubtful {
            report.passed = Some(false);
        }
        super::write_stored(output, &surface, &target, &mut report, context)?;
        Ok(report)
    }
}

/// A closed mesh that is inside out, turned.
fn turned(mesh: &TriMesh, progress: &Progress) -> Result<Option<TriMesh>, JobError> {
    if measure(mesh).volume >= 0.0 {
        return Ok(None);
    }
    let quick = CheckParams {
        self_intersections: false,
        list_limit: 0,
    };
    if !check(mesh, &quick, progress)?.closed {
        return Ok(None);
    }
    let triangles = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]);
    let turned = TriMesh::new(mesh.positions().to_vec(), triangles.collect());
    Ok(Some(turned.expect("only the order of corners is another")))
}

/// Enters the figures and the verdict into the report.
fn record(done: &library::OffsetReport, side: Side, report: &mut Report) {
    let yes = |fact: bool| f64::from(u8::from(fact));
    report.embed(done);
    report.figures.extend([
        ("certified", yes(done.certified)),
        ("uncertified_triangles", done.uncertified_facets as f64),
        ("solid", yes(done.solid)),
        ("self_intersections", done.self_intersections as f64),
        ("triangles", done.triangles as f64),
        ("extracted_triangles", done.extracted_triangles as f64),
        ("cells", done.cells as f64),
        ("deepest_level", f64::from(done.deepest_level)),
        ("tiles", done.tiles as f64),
        ("repair_rounds", f64::from(done.rounds)),
        ("split_cells", done.split_cells as f64),
        ("filled_corners", done.filled_corners as f64),
        ("feature_edges", done.feature_edges as f64),
        ("distance_least", done.least_distance),
        ("distance_most", done.most_distance),
        ("distance_most_found", done.most_distance_found),
    ]);
    if let Some(kept) = done.sheet_kept {
        report.figures.insert("sheet_kept", yes(kept));
        if !kept {
            report.record_changed(
                "the sheet itself could not be one of the skins, triangle for triangle: that skin follows it within the \
                 tolerance (where the sheet meets itself, is not manifold, faces both ways or lies within the distance of \
                 itself, see `ravec mesh check`)",
            );
        }
    }
    report.passed = Some(done.certified && done.solid);
    report.verdict.proved = Some(done.certified);
    report.verdict.solid = Some(done.solid);
    if done.solid {
        report.verdict.closed = Some(true);
    }
    for (what, count) in [
        (
            "triangles that are not proved to keep the distance",
            done.uncertified_facets,
        ),
        ("self-intersections", done.self_intersections),
    ] {
        if count > 0 {
            report.findings.push(Finding {
                what,
                count,
                defect: true,
                places: Vec::new(),
            });
        }
    }
    if !done.certified {
        report.warn(format!(
            "the result is not proved: {} of its triangles may leave the tolerance",
            done.uncertified_facets
        ));
    }
    if !done.solid {
        let own = match side {
            Side::Shell => " (a shell takes over the defects of its input: see `ravec mesh check`)",
            _ => "",
        };
        report.warn(match done.self_intersections {
            0 => format!("the result is not closed or not manifold{own}"),
            count => format!("the result meets itself {count} times{own}"),
        });
    }
}

#[cfg(test)]
mod tests;
