//! `mesh simplify`: fewer triangles for nearly the same surface.

use super::convert::{Content, Output, Start};
use super::files::{CONVERT_FIRST, record_unit_loss};
use super::judge::judge_written;
use super::{Length, weld};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::Operation;
use crate::report::Report;
use ravec::mesh::{BoundaryRule, Keep, SimplifyError, SimplifyParams, SimplifyReport, simplify};
use ravec::mesh_io::LengthUnit;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Simplify a mesh: feature edges are kept, and no new intersections appear
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP, group = clap::ArgGroup::new("goal").args(["triangles", "error"]).required(true).multiple(true)))]
pub struct Simplify {
    /// Input mesh; `-` is standard input
    pub input: PathBuf,
    /// Output mesh; its extension selects the format, `-` is standard output in the input's format
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec mesh simplify part.stl -o small.stl --triangles 200
  ravec mesh simplify part.stl -o close.3mf --error 0.1%
  ravec mesh simplify part.stl -o both.ply --triangles 100 --error 2% --feature-angle 30

A closed surface stays closed, and one without intersections stays without them. `ravec mesh compare` proves how far the \
result is from the original.

Figures: triangles_before, triangles_after, vertices_after, feature_edges (kept as such), collapses; largest_error, with \
--error; target_reached (0 or 1), with --triangles. In JSON, details is the report of the library.";

/// Parameters of [`Simplify`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Stop when there are no more triangles than this [default: go on as far as --error allows]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub triangles: Option<u64>,
    /// Largest distance between the surfaces, both ways, a length or as in 0.1% of the diagonal [default: any]
    ///
    /// Kept at vertices, middles of edges and middles of triangles; `ravec mesh compare` proves a bound everywhere.
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH"))]
    pub error: Option<Length>,
    /// Keep edges as chains where normals differ by more than this, 0 to 180 degrees; 180 keeps none
    ///
    /// Less keeps more edges, and more triangles at them; below the noise of a scan, everything stays as it is.
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEGREES", default_value_t = Params::default().feature_angle))]
    pub feature_angle: f64,
    /// Leave the borders of an open surface exactly as they are, rather than simplify them along themselves
    #[cfg_attr(feature = "cli", arg(long))]
    pub lock_boundary: bool,
    /// Let triangles meet that did not: faster, and a step further where surfaces are close to one another
    #[cfg_attr(feature = "cli", arg(long))]
    pub allow_intersections: bool,
    /// Most by which one step may turn a triangle, 0 to 90 degrees: less is more careful, more may fold the surface
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEGREES", default_value_t = Params::default().max_turn))]
    pub max_turn: f64,
    /// Least quality of new triangles, 0 (a needle) to 1 (equilateral): more avoids slivers and keeps more triangles
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Params::default().min_quality))]
    pub min_quality: f64,
    /// Make vertices one first that are no farther apart than this, a length or as in 0.01%; 0 welds equal places
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH"))]
    pub weld: Option<Length>,
    /// Format of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub output: Output,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            triangles: None,
            error: None,
            feature_angle: 60.0,
            lock_boundary: false,
            allow_intersections: false,
            max_turn: 68.0,
            min_quality: SimplifyParams::default().min_quality,
            weld: None,
            output: Output::default(),
        }
    }
}

impl Params {
    fn check(&self) -> Result<(), JobError> {
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        if self.triangles.is_none() && self.error.is_none() {
            return Err(JobError::Missing {
                fields: &["triangles", "error"],
                expected: "give at least one of the two",
            });
        }
        if let Some(error) = self.error.filter(|error| error.is_negative()) {
            return wrong("error", error.to_string(), "at least 0");
        }
        for (name, value, most, range) in [
            ("feature_angle", self.feature_angle, 180.0, "0 to 180"),
            ("max_turn", self.max_turn, 90.0, "0 to 90"),
            ("min_quality", self.min_quality, 1.0, "0 to 1"),
        ] {
            if !(0.0..=most).contains(&value) {
                return wrong(name, value.to_string(), range);
            }
        }
        weld::check(self.weld)
    }

    fn resolve(&self, diagonal: f64, unit: Option<LengthUnit>) -> Result<SimplifyParams, JobError> {
        let error = self
            .error
            .map(|error| error.resolve("error", diagonal, unit));
        Ok(SimplifyParams {
            target_triangles: self.triangles.unwrap_or(0),
            max_error: error.transpose()?.unwrap_or(f64::INFINITY),
            feature_angle_rad: self.feature_angle.to_radians(),
            boundary: if self.lock_boundary {
                BoundaryRule::Lock
            } else {
                BoundaryRule::Follow
            },
            max_turn_rad: self.max_turn.to_radians(),
            min_quality: self.min_quality,
            both_ways: true,
            avoid_intersections: !self.allow_intersections,
        })
    }
}

impl Operation for Simplify {
    const NAME: &'static str = "mesh simplify";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Writes the mesh with fewer triangles.
    ///
    /// Figures: `triangles_before`, `triangles_after`, `vertices_after`, `feature_edges` (those that were left), `collapses`;
    /// `largest_error` with [`Params::error`]; `target_reached` (0 or 1) with [`Params::triangles`]. The details are a
    /// [`SimplifyReport`]. The [`Verdict`](crate::Verdict) is about the file; a solid that is none there has not passed. Vertices on
    /// borders that lie where another one does are joined first: `joined_vertices`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Missing`], [`JobError::Simplify`], [`JobError::UnknownMeshFormat`], [`JobError::ReadMesh`], [`JobError::WriteMesh`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
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
            target,
        } = start;
        let mesh = weld::welded(file.mesh, params.weld, file.unit, &mut report, progress)?;
        let mesh = weld::with_joined_seams(mesh, input, &mut report, progress)?;
        let settings = params.resolve(mesh.bounds().diagonal(), file.unit)?;
        let simple = report.time("simplify", || {
            simplify(&mesh, &settings, &Keep::default(), |_| false, progress)
        });
        let simple = simple.map_err(|error| match error {
            SimplifyError::Cancelled(_) => JobError::Cancelled,
            cause => JobError::Simplify {
                path: input.clone(),
                cause,
            },
        })?;
        let done = simple.report;
        report.embed(&done);
        report.figures.extend([
            ("triangles_before", done.triangles_before as f64),
            ("triangles_after", done.triangles_after as f64),
            ("vertices_after", simple.mesh.positions().len() as f64),
            ("feature_edges", simple.features.len() as f64),
            ("collapses", done.collapses as f64),
        ]);
        if let Some(error) = done.largest_error {
            report.figures.insert("largest_error", error);
        }
        if let Some(wanted) = params.triangles {
            let reached = f64::from(u8::from(done.target_reached));
            report.figures.insert("target_reached", reached);
            if !done.target_reached {
                let why = reasons(&done);
                let left = done.triangles_after;
                report.warn(format!(
                    "{left} triangles are left instead of {wanted}: {why}"
                ));
            }
        }
        record_unit_loss(input, output, &target, CONVERT_FIRST, &mut report, context);
        judge_written(&mesh, &simple.mesh, target, &mut report, progress)?;
        super::write(output, &simple.mesh, &target, &mut report, context)?;
        Ok(report)
    }
}

/// Obstacles, the most common first.
fn reasons(done: &SimplifyReport) -> String {
    let vetoes = &done.vetoes;
    let mut reasons = vec![
        (vetoes.topology, "the topology would have changed"),
        (
            vetoes.features,
            "features and borders are kept (`feature_angle`)",
        ),
        (
            vetoes.turns,
            "triangles would have turned over (`max_turn`)",
        ),
        (
            vetoes.quality,
            "triangles would be too thin (`min_quality`)",
        ),
        (vetoes.error, "the error would be too large (`error`)"),
        (
            vetoes.intersections,
            "triangles would intersect (`allow_intersections`)",
        ),
    ];
    reasons.retain(|(count, _)| *count > 0);
    reasons.sort_by_key(|&(count, _)| std::cmp::Reverse(count));
    let reasons: Vec<_> = reasons.into_iter().map(|(_, text)| text).collect();
    if reasons.is_empty() {
        "no edge can be collapsed any more".to_owned()
    } else {
        reasons.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use crate::mesh::{MeshTarget, read_mesh_file, write_mesh_file};
    use ravec::mesh::{CheckParams, TriMesh, check};
    use ravec::mesh_io::{MeshFormat, MeshLimits};
    use ravec::progress::Progress;
    use ravec_scenes::solids::{cylinder, sheet, torus};

    fn simplified(mesh: &TriMesh, params: &Params) -> (TriMesh, Report) {
        let folder = tempfile::tempdir().unwrap();
        let (input, output) = (folder.path().join("a.off"), folder.path().join("b.ply"));
        let (target, progress) = (MeshTarget::new(MeshFormat::Off), Progress::none());
        write_mesh_file(&input, mesh, &target, &progress).unwrap();
        let report = run(&input, &output, params).unwrap();
        let file = read_mesh_file(&output, &MeshLimits::default(), &progress).unwrap();
        (file.mesh, report)
    }

    fn run(input: &Path, output: &Path, params: &Params) -> Result<Report, JobError> {
        let operation = Simplify {
            input: input.to_path_buf(),
            output: output.to_path_buf(),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    #[test]
    fn the_number_of_triangles_is_reached_and_a_solid_stays_one() {
        let params = Params {
            triangles: Some(300),
            ..Params::default()
        };
        let (mesh, report) = simplified(&torus(2.0, 0.7, 60, 30).mesh, &params);
        assert!(mesh.triangles().len() <= 300);
        assert_eq!(report.figures["target_reached"], 1.0);
        assert_eq!(report.warnings, [""; 0]);
        let found = check(&mesh, &CheckParams::default(), &Progress::none()).unwrap();
        assert!(found.is_solid() && found.genus == Some(1));
    }

    #[test]
    fn the_error_is_kept_and_flat_parts_vanish() {
        let params = Params {
            error: Some(Length::Percent(0.5)),
            ..Params::default()
        };
        let (_, report) = simplified(&torus(2.0, 0.7, 60, 30).mesh, &params);
        let diagonal = (5.4f64 * 5.4 * 2.0 + 1.4 * 1.4).sqrt();
        assert!(report.figures["largest_error"] <= 0.005 * diagonal);
        assert!(report.figures["triangles_after"] < 0.5 * report.figures["triangles_before"]);
        let (flat, _) = simplified(&sheet(1.0, 1.0, 20, 20).mesh, &params);
        assert_eq!(flat.triangles().len(), 2);
    }

    #[test]
    fn what_stood_in_the_way_of_the_target_is_said() {
        let params = Params {
            triangles: Some(4),
            lock_boundary: true,
            ..Params::default()
        };
        let (mesh, report) = simplified(&sheet(1.0, 1.0, 5, 5).mesh, &params);
        assert!(mesh.triangles().len() > 4);
        assert_eq!(report.figures["target_reached"], 0.0);
        assert!(report.details.unwrap()["vetoes"]["features"].as_u64() > Some(0));
        assert!(
            report.warnings[0].contains("`feature_angle`"),
            "{:?}",
            report.warnings
        );
    }

    #[test]
    fn edges_of_a_cylinder_are_kept_as_features() {
        let params = Params {
            triangles: Some(60),
            ..Params::default()
        };
        let (_, report) = simplified(&cylinder(1.0, 2.0, 64).mesh, &params);
        assert!(report.figures["feature_edges"] > 8.0);
    }

    #[test]
    fn parameters_out_of_range_are_refused_before_reading() {
        let nowhere = PathBuf::from("does/not/exist.stl");
        let good = Params {
            triangles: Some(10),
            ..Params::default()
        };
        for wrong in [
            Params::default(),
            Params {
                error: Some(Length::Units(-1.0)),
                ..good.clone()
            },
            Params {
                feature_angle: 181.0,
                ..good.clone()
            },
            Params {
                max_turn: f64::NAN,
                ..good.clone()
            },
            Params {
                min_quality: 2.0,
                ..good.clone()
            },
            Params {
                weld: Some(Length::Percent(-1.0)),
                ..good.clone()
            },
        ] {
            let error = run(&nowhere, Path::new("a.off"), &wrong);
            assert_eq!(error.unwrap_err().kind(), ErrorKind::Request);
        }
        let error = run(&nowhere, Path::new("a.png"), &good);
        assert_eq!(error.unwrap_err().kind(), ErrorKind::Request);
        let error = run(&nowhere, Path::new("a.off"), &good);
        assert_eq!(error.unwrap_err().kind(), ErrorKind::Input);
    }
}
