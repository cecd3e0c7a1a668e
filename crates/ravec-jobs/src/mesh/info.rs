//! `mesh info`: what is in a mesh file.

use super::weld;
use crate::context::Context;
use crate::error::JobError;
use crate::operation::Operation;
use crate::report::Report;
use ravec::mesh::{CheckParams, check, try_measure};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Print counts, size, area and volume of a mesh
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Info {
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
  ravec mesh info part.stl
  ravec mesh info part.stl -q --json part.json
  ravec mesh info - <part.stl

Figures: triangles, vertices, edges, parts (what shares a vertex hangs together), closed, manifold and oriented (0 or 1), \
boundary_edges; min_x to max_z, size_x to size_z and diagonal of the bounding box; area; volume, if the surface is closed and \
oriented (negative if inside out); side_min, side_mean and side_max of the triangles' sides; genus, the number of handles, if the \
surface is also manifold. Lengths are in units of the file. Vertices on borders that lie where another one does, as along seams of normals or \
texture coordinates, are joined before edges are counted (joined_vertices).";

/// Parameters of [`Info`]; there are none yet.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {}

impl Operation for Info {
    const NAME: &'static str = "mesh info";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    /// Measures the mesh.
    ///
    /// Figures: `triangles`, `vertices`, `edges`, `parts` (what shares a vertex hangs together), `closed`, `manifold` and
    /// `oriented` (0 or 1), `boundary_edges`; `min_x` to `max_z`, `size_x` to `size_z` and `diagonal` of the bounding box;
    /// `area`; of closed and oriented meshes `volume` (negative if the surface is inside out); `side_min`, `side_mean` and
    /// `side_max` of the triangles' sides; of closed, manifold and oriented meshes `genus`, the number of handles. Lengths are
    /// in units of the file. Vertices on borders that lie where another one does are joined before edges are counted:
    /// `joined_vertices`.
    ///
    /// # Errors
    /// [`JobError::ReadMesh`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let progress = &context.progress;
        context.check_files(&self.inputs(), &[])?;
        let mut report = Report::of(self, &self.params);
        let file = super::read(&self.input, &[], &mut report, context)?;
        let joined = weld::seams(&file.mesh, &self.input, &mut report, progress)?;
        let mesh = joined.as_ref().map_or(&file.mesh, |joined| &joined.mesh);
        let quick = CheckParams {
            self_intersections: false,
            list_limit: 0,
        };
        let found = report.time("check", || check(mesh, &quick, progress))?;
        let measured = report.time("measure", || try_measure(mesh, progress))?;
        report.verdict.closed = Some(found.closed);
        let vertices = found.vertices + joined.as_ref().map_or(0, |joined| joined.joined as u64);
        let yes = |fact: bool| f64::from(u8::from(fact));
        let size = measured.max - measured.min;
        let sides = measured.side_lengths;
        let figures = &mut report.figures;
        figures.extend([
            ("triangles", found.triangles as f64),
            ("vertices", vertices as f64),
            ("edges", found.edges as f64),
            ("parts", f64::from(found.components)),
            ("closed", yes(found.closed)),
            ("manifold", yes(found.manifold)),
            ("oriented", yes(found.oriented)),
            ("boundary_edges", found.boundary_edges.count as f64),
            ("area", measured.area),
        ]);
        if found.triangles > 0 {
            figures.extend([
                ("min_x", measured.min.x),
                ("min_y", measured.min.y),
                ("min_z", measured.min.z),
                ("max_x", measured.max.x),
                ("max_y", measured.max.y),
                ("max_z", measured.max.z),
                ("size_x", size.x),
                ("size_y", size.y),
                ("size_z", size.z),
                ("diagonal", measured.diagonal),
                ("side_min", sides.min),
                ("side_mean", sides.mean),
                ("side_max", sides.max),
            ]);
        }
        if found.closed && found.oriented {
            figures.insert("volume", measured.volume);
        }
        if let Some(genus) = found.genus {
            figures.insert("genus", genus as f64);
        }
        Ok(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{MeshTarget, write_mesh_file};
    use ravec::mesh::TriMesh;
    use ravec::mesh_io::MeshFormat;
    use ravec::progress::Progress;
    use ravec_scenes::solids::{cuboid, sheet};

    fn figures_of(mesh: &TriMesh) -> std::collections::BTreeMap<&'static str, f64> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let (target, progress) = (MeshTarget::new(MeshFormat::PlyBinary), Progress::none());
        write_mesh_file(&path, mesh, &target, &progress).unwrap();
        let operation = Info {
            input: path,
            params: Params::default(),
        };
        let report = operation.run(&Context::default()).unwrap();
        report.figures
    }

    #[test]
    fn the_figures_of_a_box_are_those_of_a_box() {
        let figures = figures_of(&cuboid([2.0, 3.0, 4.0].into()).mesh);
        for (name, expected) in [
            ("volume", 24.0),
            ("area", 52.0),
            ("size_y", 3.0),
            ("min_z", -2.0),
            ("max_x", 1.0),
            ("parts", 1.0),
            ("genus", 0.0),
            ("closed", 1.0),
            ("diagonal", 29f64.sqrt()),
        ] {
            assert!((figures[name] - expected).abs() < 1e-12, "{name}");
        }
    }

    #[test]
    fn an_open_mesh_has_no_volume_and_an_empty_one_no_bounds() {
        let figures = figures_of(&sheet(1.0, 1.0, 3, 2).mesh);
        assert_eq!((figures["closed"], figures["boundary_edges"]), (0.0, 10.0));
        assert!(!figures.contains_key("volume") && !figures.contains_key("genus"));
        let figures = figures_of(&TriMesh::default());
        assert_eq!(figures["triangles"], 0.0);
        assert!(!figures.contains_key("diagonal"));
    }
}
