//! `boolean`: meshes combined by an expression, exact where they meet.

mod attributes;
mod named;
mod origins;
mod picture;
mod place;

use super::as_read::{coordinates_of, joins_places};
use super::convert::{Output, rounds, scale_to_meters, scaled};
use super::files::{CONVERT_FIRST, record_unit_loss};
use super::{MeshTarget, Viewpoint};
use crate::context::Context;
use crate::error::JobError;
use crate::files::check_target;
use crate::operation::{Operation, paths};
use crate::report::{Finding, Report};
use bytesize::ByteSize;
use glam::DVec2;
use ravec::boolean as library;
use ravec::boolean::{
    BooleanError, BooleanReport, CloseRule, Expr, Inside, OpenRule, ParseExprError,
};
use ravec::mesh::{Coordinates, TriMesh};
use ravec::mesh_io::{Attributes, LengthUnit, MeshFile, MeshFormat, UnitRatio};
use ravec::mesh_render::View;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

pub use named::{NamedFile, names};
pub use picture::{origin_colors, with_seams};
pub use place::Placement;

/// Combine meshes by a Boolean expression, exactly; triangles away from the cuts stay unchanged
///
/// The exit code is 5 if the result was written but is not solid, or probably not what was meant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Boolean {
    /// Boolean expression, as in '(a | b) - c & d': | is union, & intersection, - difference, ^ symmetric difference; & comes
    /// before the others, which go from left to right. Or union, intersection, difference or symmetric-difference of
    /// all files
    pub expression: String,
    /// Input meshes, each with its name in the expression; without names they are a, b, c and so on. `-` is standard input
    #[cfg_attr(feature = "cli", arg(required = true, value_name = "[NAME=]FILE", value_parser = NamedFile::parser()))]
    pub files: Vec<NamedFile>,
    /// Output mesh; its extension selects the format, `-` is standard output in the first input's format
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Write the origin of each triangle, as .csv or .json: its mesh, its index there, whether it was flipped, and whether
    /// it is whole
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub origins: Option<PathBuf>,
    /// Render the result: whole triangles blue, pieces orange, closed holes green, seams red
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub picture: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec boolean union part.stl other.ply -o all.stl
  ravec boolean difference part.stl other.ply -o cut.ply --origins cut.csv
  ravec boolean '(a | b) - a & b' part.stl other.ply -o both.ply --picture both.png
  ravec boolean 'part - drill' part=part.stl drill=other.ply -o drilled.3mf
  ravec boolean union part.stl other.ply -o hull.ply --inside outer-hull --json -
  ravec boolean a-b part.stl other.ply -o moved.ply --place b:0,0,0.5,90,0,0
  ravec boolean union sheet.stl -o relief.stl --close base

Names are letters, digits and underscores. & comes before the other operators, which go from left to right: a | b - c & d is \
(a | b) - (c & d). A file that the expression does not name is not read.

Meshes may be any triangles. A mesh stands for the places where its winding number is above one half (--inside positive); one that is \
inside out is turned, and so are closed parts that are inside out and touch no others. Other parts that are inside out are left out; \
warnings give their places and volumes, and the exit code is 5: --inside outer-hull keeps them.

An open mesh is closed first: edges that nearly meet are joined, holes filled by surfaces of least area, but not by what repeats the \
mesh's own wall. --close lid fills each hole by itself, band joins holes that face each other, base puts a relief on a flat base, \
2% of its diagonal below its lowest point along z. An open sheet minus a solid, or cut with one by &, is not closed but trimmed, and so is \
the result an open surface (solid 0, trimmed 1); --open close closes sheets, too, --open trim trims all open meshes. What was assumed \
about a mesh is a warning and stands in the report.

Triangles that no other mesh touches come out as they went in. The result is solid if it \
is closed, manifold and does not meet itself; if it is not, it is written all the same, a warning says what is wrong, and the exit code \
is 5. So it is if a mesh or the result encloses no volume. Where solids have nothing in common the result is an empty mesh, and no error. \
Where coordinates become 32-bit floats (binary STL, glTF, --precision single), the result is rounded and repaired on these: all that is \
said holds for the file. STL joins vertices at equal places, so that solids which touch in an edge or a vertex are drawn apart there by some \
millionths of the size, and a warning says so.

--place NAME:tx,ty,tz,rx,ry,rz,s moves a mesh before it is combined: it is scaled by s about the center of its bounding box, turned there \
by rx degrees about the x axis, then ry about y, then rz about z (the axes stay where they are; counter-clockwise seen from their tips), and \
shifted by tx,ty,tz in units of the first mesh. Scale, or turns and scale, may be left out. Quarter turns are exact.

Colors of the vertices of PLY files follow into a PLY file, texture coordinates of OBJ and glTF files into one of these. --origins has a row for each triangle: mesh, triangle (none for one that \
closes a hole), whether it was turned, and whether it is whole.

Figures: triangles, kept_triangles, seam_edges, intersecting_pairs, repair_rounds, self_intersections, solid and trimmed (0 or 1), \
volume (0 if trimmed), area; largest_rounding, where coordinates become 32-bit floats; separated_vertices, where solids that touch were \
drawn apart. In JSON, result is what was found out about each mesh, passed the \
verdict, and details the report of the library.";

/// Parameters of [`Boolean`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The places that each mesh stands for
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "RULE", default_value_t = Params::default().inside))]
    pub inside: Inside,
    /// Closing of open meshes
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "RULE", default_value_t = Params::default().close))]
    pub close: CloseRule,
    /// Open meshes that are trimmed instead of closed
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "RULE", default_value_t = Params::default().open))]
    pub open: OpenRule,
    /// Place of a mesh: shift in units of the first mesh, turns about x, then y, then z in degrees, scale; turned and scaled about
    /// the center of its box. May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(long = "place", value_name = "NAME:tx,ty,tz[,rx,ry,rz[,s]]")
    )]
    pub places: Vec<Placement>,
    /// The most memory to work in, such as 2GiB [default: as much as it takes]
    #[cfg_attr(feature = "cli", arg(long, value_name = "SIZE"))]
    pub memory: Option<ByteSize>,
    /// Unit of all inputs' coordinates, whatever the files say; most formats say nothing
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "UNIT"))]
    pub unit: Option<LengthUnit>,
    /// Viewpoint of --picture: front, right, back, left, top, bottom, iso, or degrees around and up, as in 30,20
    #[cfg_attr(feature = "cli", arg(long, value_name = "VIEW", allow_hyphen_values = true, default_value_t = Params::default().view))]
    pub view: Viewpoint,
    /// Format of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub output: Output,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            inside: Inside::default(),
            close: CloseRule::default(),
            open: OpenRule::default(),
            places: Vec::new(),
            memory: None,
            unit: None,
            view: Viewpoint(View::ISO),
            output: Output::default(),
        }
    }
}

/// Puts an operator over expressions.
type Operator = fn(Vec<Expr>) -> Expr;

/// The words that stand for an operator over all meshes.
const SHORTHANDS: [(&str, Operator); 4] = [
    ("union", Expr::Union),
    ("intersection", Expr::Intersection),
    ("difference", Expr::Difference),
    ("symmetric-difference", Expr::SymmetricDifference),
];

/// The expression over meshes with these names. A shorthand stands for an operator over all of them, unless one has its name.
fn parsed(text: &str, names: &[String]) -> Result<Expr, JobError> {
    let word = text.trim();
    let shorthand = SHORTHANDS.iter().find(|(known, _)| *known == word);
    if let Some((_, operator)) = shorthand
        && !names.iter().any(|name| name == word)
    {
        return Ok(operator((0..names.len()).map(Expr::Mesh).collect()));
    }
    Expr::parse_with(text, names).map_err(|cause: ParseExprError| JobError::Expression {
        caret: cause.caret(text),
        cause,
    })
}

impl Operation for Boolean {
    const NAME: &'static str = "boolean";

    fn inputs(&self) -> Vec<&Path> {
        self.files.iter().map(|file| file.path.as_path()).collect()
    }

    fn outputs(&self) -> Vec<&Path> {
        paths(&self.output, [&self.origins, &self.picture])
    }

    /// Combines the meshes in `files` by `expression`.
    ///
    /// `expression` is one as [`Expr::parse`] reads it, or one of the words `union`, `intersection`, `difference` (the first without
    /// all others) and `symmetric-difference`, over all files in their order. Files without a name are called a, b, c and so on. A
    /// file that the expression does not name is not read; a warning says so.
    ///
    /// If files name different units, meshes are scaled to that of the first. After that they are moved to their [`Placement`]. Colors of the vertices of PLY files follow into a
    /// PLY file: between the corners of a triangle they are mixed, and vertices where meshes meet take that of one of them. Texture
    /// coordinates of OBJ and glTF files follow into one of these: each piece of a triangle shows what was there.
    ///
    /// [`Report::passed`] says whether the result is closed, manifold and free of self-intersections as readers of the file see
    /// it (rounded to 32-bit floats where these are written, with vertices at equal places joined where the format is STL), or
    /// empty, or an open surface trimmed by solids, and nothing about the meshes casts doubt on it ([`BooleanReport::passed`]). If
    /// not, it is written all the same.
    ///
    /// Figures: `triangles`, `kept_triangles` (those of an input, whole and unchanged), `seam_edges` (along which surfaces were
    /// cut), `intersecting_pairs` of triangles, `repair_rounds` after rounding to double precision, `self_intersections`, `solid` and
    /// `trimmed` (0 or 1), `volume` in cubic units of the file that is written (0 of a trimmed surface), `area`; `largest_rounding` if
    /// it holds 32-bit floats, `separated_vertices` if STL made that necessary. The result, in JSON, is
    /// an [`OperandReport`](library::OperandReport) of each input with its `name` and `path`; its `assumptions` are warnings, too.
    /// The details are a [`BooleanReport`].
    ///
    /// # Errors
    /// [`JobError::Expression`], [`JobError::Parameter`], [`JobError::UnknownMeshFormat`], [`JobError::ReadMesh`],
    /// [`JobError::NoTriangles`], [`JobError::Boolean`], [`JobError::WriteMesh`], [`JobError::Write`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            files,
            output,
            params,
            ..
        } = self;
        let progress = &context.progress;
        let names = names(files)?;
        let expr = parsed(&self.expression, &names)?;
        let used = expr.meshes();
        let places = place::placements(&params.places, &names)?;
        params.output.check(output, context)?;
        if let Some(path) = &self.picture {
            check_target(path, context)?;
        }
        if let Some(path) = &self.origins {
            origins::check(path)?;
        }
        let inputs: Vec<&Path> = used.iter().map(|&i| files[i].path.as_path()).collect();
        context.check_files(&inputs, &self.outputs())?;
        let mut report = Report::of(self, params);
        for (i, name) in names.iter().enumerate() {
            if !used.contains(&i) {
                report.record_dropped(format!(
                    "{} is {name}, which the expression does not name: it was not read",
                    files[i].path.display()
                ));
            }
        }
        let read = self.read_all(&used, &places, &mut report, context)?;
        let Inputs {
            meshes,
            colors,
            textures,
            _files,
            target,
        } = read;
        let asked = library::BooleanParams {
            inside: params.inside,
            coordinates: coordinates_of(target),
            separate: joins_places(target),
            close: params.close,
            open: params.open,
            memory_bytes: params.memory.map(|size| size.as_u64()),
        };
        let result = report.time("boolean", || {
            library::boolean(&meshes, &expr, &asked, progress)
        });
        let result = result.map_err(|cause| match cause {
            BooleanError::Cancelled => JobError::Cancelled,
            cause => JobError::Boolean { cause },
        })?;
        record(
            &result.report,
            &used,
            &names,
            files,
            asked.coordinates,
            &mut report,
        );
        report.embed(&result.report);
        let yes = |fact: bool| f64::from(u8::from(fact));
        let done = &result.report;
        report.figures.extend([
            ("triangles", done.triangles as f64),
            ("kept_triangles", done.kept_triangles as f64),
            ("seam_edges", result.feature_edges.len() as f64),
            ("intersecting_pairs", done.intersecting_pairs as f64),
            ("repair_rounds", f64::from(done.repair_rounds)),
            ("self_intersections", done.self_intersections as f64),
            ("solid", yes(done.solid)),
            ("trimmed", yes(done.trimmed)),
            ("volume", done.volume),
            ("area", done.area),
        ]);
        if rounds(&target) {
            report.figures.insert("largest_rounding", done.rounded);
        }
        if done.moved > 0.0 {
            report.record_changed(format!(
                "surfaces nearly lie on one another: vertices there were moved by up to {:.1e} to keep the result free of intersections",
                done.moved
            ));
        }
        if done.separated > 0 && done.shared_places == 0 {
            report
                .figures
                .insert("separated_vertices", done.separated as f64);
            report.record_changed(format!(
                "solids touch in edges or vertices, which STL cannot keep apart: {} vertices there were moved by up to {:.1e} (PLY, OBJ, \
                 OFF, 3MF and glTF keep them in place)",
                done.separated, done.separation
            ));
        }
        if result.mesh.triangles().is_empty() {
            report.warn("nothing is inside: the result is empty");
        }
        let carried = Attributes {
            colors: &attributes::colors_of(&result, &meshes, &colors),
            texture: &attributes::texture_of(&result, &meshes, &textures),
            objects: &[],
        };
        super::write_with(output, &result.mesh, carried, &target, &mut report, context)?;
        if let Some(path) = &self.origins {
            let inputs: Vec<_> = names.iter().zip(files).collect();
            origins::write(path, &inputs, &result.origins, &mut report, context)?;
        }
        if let Some(path) = &self.picture {
            picture::write(path, &result, params.view, &mut report, context)?;
        }
        Ok(report)
    }
}

/// Scale of coordinates in a unit to those in that of the first mesh, if both are known and differ.
pub fn unit_scale(unit: Option<LengthUnit>, first: Option<LengthUnit>) -> Option<UnitRatio> {
    let (unit, first) = unit.zip(first)?;
    (unit != first).then(|| unit.per(first))
}

/// Input as read.
struct Inputs {
    /// By index; those that are not used are empty.
    meshes: Vec<TriMesh>,
    /// Colors of their vertices, where there are any.
    colors: Vec<Vec<[u8; 4]>>,
    /// Texture coordinates of the corners of their triangles, where there are any.
    textures: Vec<Vec<[DVec2; 3]>>,
    /// The rest of the files: the memory of all that was read stays reserved as long as they are there.
    _files: Vec<MeshFile>,
    target: MeshTarget,
}

impl Boolean {
    /// Reads the meshes that are used, scales them to the unit of the first, and moves them to their places.
    fn read_all(
        &self,
        used: &[usize],
        places: &[Option<&Placement>],
        report: &mut Report,
        context: &Context,
    ) -> Result<Inputs, JobError> {
        let Self { files, params, .. } = self;
        let outputs = self.outputs();
        // what standard output takes is known once the first mesh is
        let output = params
            .output
            .target(&self.output, MeshFormat::PlyBinary, context)?;
        let mut target: Option<MeshTarget> = None;
        let mut meshes = vec![TriMesh::default(); files.len()];
        let mut colors = vec![Vec::new(); files.len()];
        let mut textures = vec![Vec::new(); files.len()];
        let mut read = Vec::new();
        for &i in used {
            let path = &files[i].path;
            let mut file = super::read_with_attributes(path, &outputs, report, context)?;
            if file.mesh.triangles().is_empty() {
                return Err(JobError::NoTriangles { path: path.clone() });
            }
            let unit = params.unit.or(file.unit);
            let target = match &mut target {
                Some(target) => target,
                none => {
                    let mut first = params.output.target(&self.output, file.format, context)?;
                    first.unit = unit;
                    none.insert(first)
                }
            };
            if let (Some(from), Some(to)) = (unit, target.unit)
                && let Some(scale) = unit_scale(unit, target.unit)
            {
                report.record_changed(format!(
                "{} is in units of one {from}: it was scaled by {} to the {to} of the first mesh",
                path.display(),
                scale.factor()
            ));
                file.mesh = scaled(file.mesh, scale, path)?;
            }
            if let Some(placement) = places[i] {
                file.mesh = placement.place(file.mesh)?;
            }
            // results in memory hold all attributes
            if !context.is_intermediate(&self.output) {
                super::keep_supported(&mut file, path, target, report);
            }
            meshes[i] = std::mem::take(&mut file.mesh);
            colors[i] = std::mem::take(&mut file.colors);
            textures[i] = std::mem::take(&mut file.texture);
            read.push(file);
        }
        // an expression always names a mesh
        let mut target = target.unwrap_or(output);
        // rounding depends on the unit: what is judged has to be what is written
        if params.unit.is_none()
            && let Some(&first) = used.first()
        {
            let path = &files[first].path;
            record_unit_loss(path, &self.output, &target, CONVERT_FIRST, report, context);
        }
        if let Some(scale) = scale_to_meters(target) {
            for &i in used {
                meshes[i] = scaled(std::mem::take(&mut meshes[i]), scale, &files[i].path)?;
            }
            target.unit = Some(LengthUnit::Meter);
        }
        Ok(Inputs {
            meshes,
            colors,
            textures,
            _files: read,
            target,
        })
    }
}

/// Enters the verdict, and what was assumed about the inputs, into the report.
fn record(
    done: &BooleanReport,
    used: &[usize],
    names: &[String],
    files: &[NamedFile],
    coordinates: Coordinates,
    report: &mut Report,
) {
    let mut inputs = Vec::new();
    for &i in used {
        let path = files[i].path.display().to_string();
        let operand = &done.operands[i];
        for assumption in &operand.assumptions {
            report.record_assumed(format!("{path}: {assumption}"));
        }
        for doubt in &operand.doubts {
            report.warn(format!("{path}: {doubt}"));
        }
        if done.pruned.contains(&(i as u32)) {
            report.record_dropped(format!("{path} does not matter for the result"));
        }
        let mut input = serde_json::json!(operand);
        input["name"] = names[i].as_str().into();
        input["path"] = path.into();
        inputs.push(input);
    }
    report.result = Some(serde_json::Value::Array(inputs));
    let is_empty = done.triangles == 0;
    let sound = done.solid || is_empty || done.trimmed;
    report.passed = Some(done.passed());
    if !is_empty {
        // an open surface is none by intent
        report.verdict.solid = (!done.trimmed).then_some(done.solid);
        report.verdict.closed = match (done.solid, done.trimmed) {
            (true, _) => Some(true),
            (_, true) => Some(false),
            _ => None,
        };
    }
    for doubt in &done.doubts {
        report.warn(doubt.clone());
    }
    if done.self_intersections > 0 {
        report.findings.push(Finding {
            what: "self-intersections",
            count: done.self_intersections,
            defect: true,
            places: Vec::new(),
        });
    }
    if !sound || done.self_intersections > 0 {
        let cure = match coordinates {
            Coordinates::Double => "",
            Coordinates::Single => {
                ", in the 32-bit floats of the file: PLY, OBJ, OFF and 3MF keep it in 64 bits"
            }
        };
        report.warn(match (done.self_intersections, done.shared_places) {
            (0, 0) => format!("the result is not closed or not manifold{cure}"),
            (0, shared) => format!(
                "solids touch in {shared} vertices, which STL joins: the result is not manifold there (PLY, OBJ, OFF, 3MF and glTF keep \
                 them apart)"
            ),
            (count, _) => format!("the result meets itself {count} times{cure}"),
        });
    }
}

#[cfg(test)]
mod tests;
