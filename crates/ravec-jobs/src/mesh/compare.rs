//! `mesh compare`: how far two surfaces are apart, with a proof.

use super::Length;
use crate::context::Context;
use crate::error::JobError;
use crate::operation::Operation;
use crate::report::{Finding, Place, Report};
use ravec::mesh::{Bvh, HausdorffError, HausdorffParams, OneSided, TriMesh, distances_to};
use ravec::mesh_io::MeshFile;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Measure the distance between two surfaces, both ways, with proved bounds
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Compare {
    /// Reference; `-` is standard input
    pub a: PathBuf,
    /// Mesh to compare with it; `-` is standard input
    pub b: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec mesh compare part.stl other.ply
  ravec mesh compare part.stl other.ply --tolerance 0.01% --within 5%
  ravec mesh compare part.stl other.ply -q --json distance.json

Figures: distance_lower and distance_upper, which enclose the largest distance of a point of one surface to the other surface; \
distance_percent, the upper bound in percent of diagonal, that of the bounding box of A; a_to_b_lower, a_to_b_upper, a_to_b_mean \
and a_to_b_rms (root mean square) for the points of A, and b_to_a_... for those of B. The bounds hold for all points; means \
are taken from evenly spread samples. With --within, passed is the verdict.";

/// Parameters of [`Compare`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Largest difference between the bounds of the distance, a length or as in 0.01% of the diagonal of A
    ///
    /// Less takes longer where surfaces are curved in different ways.
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH", default_value_t = Params::default().tolerance))]
    pub tolerance: Length,
    /// Places on each surface for mean and root mean square, at most 100 million; 0 leaves both out
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Params::default().samples))]
    pub samples: u32,
    /// Pass only if no place is farther than this from the other surface, but for rounding, a length or as in 0.1% of the
    /// diagonal of A; else the exit code is 1
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH"))]
    pub within: Option<Length>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            tolerance: Length::Percent(0.1),
            samples: HausdorffParams::default().samples,
            within: None,
        }
    }
}

/// Minimum tolerance as a share of the diagonal: a smaller one measures the rounding of coordinates.
const MIN_TOLERANCE: f64 = 1e-9;

/// Rounding error of the bounds, as a share of the largest coordinate: a few operations, each of half an ulp. A smaller value
/// finds a distance between a mesh and itself.
const ROUNDINGS: f64 = 32.0 * f64::EPSILON;

impl Params {
    fn check(&self) -> Result<(), JobError> {
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        if !self.tolerance.is_positive() {
            return wrong("tolerance", self.tolerance.to_string(), "above 0");
        }
        if self.samples > 100_000_000 {
            let samples = self.samples.to_string();
            return wrong("samples", samples, "0 to 100000000");
        }
        match self.within {
            Some(within) if within.is_negative() => {
                wrong("within", within.to_string(), "at least 0")
            }
            _ => Ok(()),
        }
    }
}

impl Operation for Compare {
    const NAME: &'static str = "mesh compare";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.a, &self.b]
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    /// Compares the surface `b` with the reference `a`, both ways.
    ///
    /// Figures, in units of the files: `distance_lower` and `distance_upper`, between which the two-sided Hausdorff distance
    /// lies, and `distance_percent`, the upper one in percent of `diagonal`, the diagonal of the bounding box of `a`;
    /// `a_to_b_lower`, `a_to_b_upper`, `a_to_b_mean` and `a_to_b_rms` for the points of `a`, and the same for `b`. Means are
    /// taken from evenly spread samples. Findings are the farthest places. With [`Params::within`], [`Report::passed`] says
    /// whether the upper bound is no more than that.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::ReadMesh`], [`JobError::NoTriangles`], [`JobError::InputTwice`] if both are standard
    /// input, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { a, b, params } = self;
        let progress = &context.progress;
        params.check()?;
        context.check_files(&self.inputs(), &[])?;
        let mut report = Report::of(self, params);
        let (file_a, file_b) = (
            read_surface(a, &mut report, context)?,
            read_surface(b, &mut report, context)?,
        );
        let (mesh_a, mesh_b) = (&file_a.mesh, &file_b.mesh);
        let diagonal = mesh_a.bounds().diagonal();
        let tolerance = params
            .tolerance
            .resolve("tolerance", diagonal, file_a.unit)?;
        let size = diagonal.max(mesh_b.bounds().diagonal());
        if tolerance < MIN_TOLERANCE * size {
            return Err(JobError::Parameter {
                field: "tolerance",
                value: params.tolerance.to_string(),
                range: "at least 0.0000001% of the larger diagonal",
            });
        }
        let asked = HausdorffParams {
            // of a single point, any length will do
            tolerance: tolerance.max(f64::MIN_POSITIVE),
            samples: params.samples,
            ..HausdorffParams::default()
        };
        let failed = |error: HausdorffError| match error {
            HausdorffError::Cancelled(_) => JobError::Cancelled,
            other => JobError::Parameter {
                field: "tolerance",
                value: params.tolerance.to_string(),
                range: match other {
                    HausdorffError::Empty => "given for meshes with triangles",
                    _ => "a positive length",
                },
            },
        };
        let a_to_b = report
            .time("a to b", || {
                distances_to(mesh_a, &Bvh::try_new(mesh_b, progress)?, &asked, progress)
            })
            .map_err(failed)?;
        let b_to_a = report
            .time("b to a", || {
                distances_to(mesh_b, &Bvh::try_new(mesh_a, progress)?, &asked, progress)
            })
            .map_err(failed)?;
        let (lower, upper) = (
            a_to_b.lower.max(b_to_a.lower),
            a_to_b.upper.max(b_to_a.upper),
        );
        report.figures.extend([
            ("distance_lower", lower),
            ("distance_upper", upper),
            ("diagonal", diagonal),
            ("a_to_b_lower", a_to_b.lower),
            ("a_to_b_upper", a_to_b.upper),
            ("b_to_a_lower", b_to_a.lower),
            ("b_to_a_upper", b_to_a.upper),
        ]);
        if diagonal > 0.0 {
            let percent = 100.0 * upper / diagonal;
            report.figures.insert("distance_percent", percent);
        }
        if params.samples > 0 {
            report.figures.extend([
                ("a_to_b_mean", a_to_b.mean),
                ("a_to_b_rms", a_to_b.rms),
                ("b_to_a_mean", b_to_a.mean),
                ("b_to_a_rms", b_to_a.rms),
            ]);
        }
        report.findings = vec![
            farthest("farthest place of A from B", &a_to_b),
            farthest("farthest place of B from A", &b_to_a),
        ];
        if upper - lower > 1.01 * tolerance {
            report.warn(
            "the distance could not be enclosed as closely as asked for within the most memory that is taken; give a \
             larger `tolerance`",
        );
        }
        if let Some(within) = params.within {
            let within = within.resolve("within", diagonal, file_a.unit)?;
            let within = within + ROUNDINGS * farthest_coordinate(&[mesh_a, mesh_b]);
            report.passed = Some(upper <= within);
            if lower <= within && within < upper {
                report.warn("the bounds do not decide about `within`; give a smaller `tolerance`");
            }
        }
        Ok(report)
    }
}

/// Reads a mesh that must have triangles.
pub(super) fn read_surface(
    path: &Path,
    report: &mut Report,
    context: &Context,
) -> Result<MeshFile, JobError> {
    let file = super::read(path, &[], report, context)?;
    if file.mesh.triangles().is_empty() {
        return Err(JobError::NoTriangles {
            path: path.to_path_buf(),
        });
    }
    Ok(file)
}

/// Largest absolute coordinate.
fn farthest_coordinate(meshes: &[&TriMesh]) -> f64 {
    let boxes = meshes.iter().map(|mesh| mesh.bounds());
    boxes
        .flat_map(|bounds| [bounds.min, bounds.max])
        .map(|corner| corner.abs().max_element())
        .fold(0.0, f64::max)
}

/// Six digits, which are enough for a sentence.
pub(super) fn short(number: f64) -> f64 {
    format!("{number:.5e}").parse().unwrap_or(number)
}

fn farthest(what: &'static str, side: &OneSided) -> Finding {
    let [x, y, z] = side.to.to_array().map(short);
    Finding {
        what,
        count: 1,
        defect: false,
        places: vec![Place {
            at: side.from.to_array(),
            note: Some(format!(
                "{} away from the closest place ({x}, {y}, {z})",
                short(side.lower)
            )),
            ..Place::default()
        }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use crate::mesh::{MeshTarget, write_mesh_file};
    use ravec::mesh_io::MeshFormat;
    use ravec::progress::Progress;
    use ravec_scenes::solids::{cuboid, icosphere};

    fn compared(a: &TriMesh, b: &TriMesh, params: &Params) -> Result<Report, JobError> {
        let folder = tempfile::tempdir().unwrap();
        let (target, progress) = (MeshTarget::new(MeshFormat::PlyBinary), Progress::none());
        let source = |name: &str, mesh: &TriMesh| {
            let path = folder.path().join(name);
            write_mesh_file(&path, mesh, &target, &progress).unwrap();
            path
        };
        let (a, b) = (source("a.ply", a), source("b.ply", b));
        let params = params.clone();
        Compare { a, b, params }.run(&Context::default())
    }

    #[test]
    fn spheres_about_the_same_middle_are_the_difference_of_their_radii_apart() {
        let (a, b) = (icosphere(1.0, 4), icosphere(1.25, 4));
        let report = compared(&a.mesh, &b.mesh, &Params::default()).unwrap();
        let slack = a.deviation + b.deviation;
        for name in ["distance_lower", "distance_upper", "a_to_b_mean"] {
            let figure = report.figures[name];
            assert!((figure - 0.25).abs() < slack + 4e-3, "{name}: {figure}");
        }
        assert!(report.figures["distance_upper"] >= report.figures["distance_lower"]);
        assert_eq!(report.findings.len(), 2);
        assert_eq!(report.passed, None);
    }

    #[test]
    fn numbers_in_sentences_have_six_digits() {
        assert_eq!(short(0.001_413_305_667_9), 0.001_413_31);
        assert_eq!(short(-123_456_789.0), -123_457_000.0);
        assert_eq!(short(0.0), 0.0);
    }

    #[test]
    fn a_mesh_is_within_nothing_of_itself_and_a_larger_one_is_not() {
        let (a, b) = (
            cuboid([1.0; 3].into()).mesh,
            cuboid([1.1, 1.0, 1.0].into()).mesh,
        );
        let ball = icosphere(3.0, 3).shifted([100.0, 0.1, 7.0].into()).mesh;
        let same = Params {
            within: Some(Length::Units(0.0)),
            ..Params::default()
        };
        assert_eq!(compared(&ball, &ball, &same).unwrap().passed, Some(true));
        let within = |length| Params {
            within: Some(length),
            ..Params::default()
        };
        let passed = |b: &TriMesh, length| compared(&a, b, &within(length)).unwrap().passed;
        assert_eq!(passed(&a, Length::Units(0.0)), Some(true));
        assert_eq!(passed(&b, Length::Units(0.04)), Some(false));
        assert_eq!(passed(&b, Length::Percent(3.0)), Some(true));
    }

    #[test]
    fn parameters_out_of_range_and_empty_meshes_are_refused() {
        let a = cuboid([1.0; 3].into()).mesh;
        let refused = |b: &TriMesh, params: &Params| compared(&a, b, params).unwrap_err();
        for tolerance in [
            Length::Units(0.0),
            Length::Percent(-1.0),
            Length::Units(1e-12),
        ] {
            let params = Params {
                tolerance,
                ..Params::default()
            };
            assert_eq!(
                refused(&a, &params).kind(),
                ErrorKind::Request,
                "{tolerance}"
            );
        }
        let params = Params {
            within: Some(Length::Units(-1.0)),
            ..Params::default()
        };
        assert_eq!(refused(&a, &params).kind(), ErrorKind::Request);
        let error = refused(&TriMesh::default(), &Params::default());
        assert!(matches!(error, JobError::NoTriangles { .. }), "{error}");
    }
}
