//! The part of the demonstration that is about offsets: of solids drawn by formulas, and of a soup.

use super::{Detail, drawn, pictured};
use crate::error::bug;
use crate::page::{Figure, Gallery, Solid};
use glam::DVec3;
use ravec::mesh::{Bvh, TriMesh, vertex_distances};
use ravec::mesh_render::{
    Camera, ColorMap, FeatureLines, LineStyle, Paint, RenderParams, Section, Values, View,
};
use ravec::offset::{Offset, OffsetCell, OffsetError, OffsetParams, Side, offset, offset_cells};
use ravec::progress::Progress;
use ravec_jobs::JobError;
use ravec_jobs::Report;
use ravec_scenes::solids::{comb, cone, crossing_plates, cuboid, torus};

/// Puts the section about offsets on the page.
///
/// Figures: `offset_triangles` of the offset in colors, `offset_error_percent`, the largest error at the vertices of a fine
/// subdivision of it in percent of its tolerance, `offset_cells`, from which its surface was taken, and `offset_proved` (0
/// or 1), whether all results of the section are.
pub fn show(
    page: &mut Gallery,
    report: &mut Report,
    detail: Detail,
    progress: &Progress,
) -> Result<(), JobError> {
    page.section(
        "Offsets",
        "The surface at a distance from any triangles: for walls of a given thickness, for clearances, and to make a printable \
         solid of a sheet. The result is closed and free of intersections, keeps sharp creases, and is proved to be within the \
         tolerance.",
    );
    let mut studio = Studio {
        rows: Vec::new(),
        proved: true,
        detail,
        progress,
    };
    page.figures(&studio.growth()?);
    page.figures(&studio.insides()?);
    page.figures(&studio.soup()?);
    page.paragraph(
        "The surface comes from the cells of an octree. Colors show their size, from dark (large) to yellow (small): they \
         are small only where the surface is round; one cell is enough for a sharp corner.",
    );
    let figures = studio.cells(report)?;
    page.figures(&figures);
    page.paragraph(
        "The same surface before and after its triangles are merged. Colors show its error, from blue (too near, by the whole \
         tolerance) to red (too far).",
    );
    let figures = studio.exactness(report)?;
    page.figures(&figures);
    page.table(
        &[
            "offset",
            "distance",
            "tolerance",
            "proved to be between",
            "triangles found",
            "triangles",
            "creased edges",
            "proved",
            "self-intersections",
        ],
        &studio.rows,
    );
    let proved = f64::from(u8::from(studio.proved));
    report.figures.insert("offset_proved", proved);
    Ok(())
}

struct Studio<'a> {
    rows: Vec<Vec<String>>,
    proved: bool,
    detail: Detail,
    progress: &'a Progress,
}

impl Studio<'_> {
    /// The offset of a mesh, as a row of the table.
    fn offset(
        &mut self,
        name: &str,
        mesh: &TriMesh,
        params: &OffsetParams,
    ) -> Result<TriMesh, JobError> {
        let Offset { mesh, report } = offset(mesh, params, self.progress).map_err(refused)?;
        let proved = report.certified && report.solid;
        self.proved &= proved;
        self.rows.push(vec![
            name.to_owned(),
            rounded(params.distance),
            rounded(params.tolerance),
            format!(
                "{:.4} and {:.4}",
                report.least_distance, report.most_distance
            ),
            report.extracted_triangles.to_string(),
            report.triangles.to_string(),
            report.feature_edges.to_string(),
            if proved { "yes" } else { "no" }.to_owned(),
            report.self_intersections.to_string(),
        ]);
        Ok(mesh)
    }

    fn drawn(
        &self,
        mesh: &TriMesh,
        params: &RenderParams,
        caption: &str,
    ) -> Result<Figure, JobError> {
        drawn(mesh, &Paint::Plain, params, caption, self.progress)
    }

    fn look(&self) -> RenderParams {
        RenderParams {
            camera: Camera {
                view: View::new(30.0, 30.0),
                ..Camera::default()
            },
            ..self.detail.picture()
        }
    }

    /// Cut through the middle, seen from the side that is taken away.
    fn cut(&self) -> RenderParams {
        RenderParams {
            section: Some(Section {
                normal: -DVec3::Y,
                offset: 0.0,
                capped: true,
            }),
            ..self.detail.picture()
        }
    }

    fn growth(&mut self) -> Result<Vec<Figure>, JobError> {
        let fins = fins();
        let mut figures = vec![self.drawn(&fins, &self.look(), "A comb")?];
        for distance in [0.05, 0.1, 0.4] {
            let params = OffsetParams {
                distance,
                // at most a fifth of the distance, or parts would be missing
                tolerance: self.detail.length(0.01).min(0.2 * distance),
                side: Side::Outer,
                ..OffsetParams::default()
            };
            let grown = self.offset("comb, outer", &fins, &params)?;
            figures.push(self.drawn(
                &grown,
                &self.look(),
                &format!("The comb, grown by {distance}"),
            )?);
        }
        Ok(figures)
    }

    fn insides(&mut self) -> Result<Vec<Figure>, JobError> {
        let detail = self.detail;
        let shell = |distance: f64| OffsetParams {
            distance,
            tolerance: detail.length(0.1 * distance),
            side: Side::Shell,
            ..OffsetParams::default()
        };
        let hat = cone(1.0, 2.0, detail.edges(72)).mesh;
        let hollow = self.offset("cone, shell", &hat, &shell(0.12))?;
        let inner = OffsetParams {
            side: Side::Inner,
            ..shell(0.025)
        };
        let shrunk = self.offset("comb, inner", &fins(), &inner)?;
        let ring = torus(2.0, 0.8, detail.edges(96), detail.edges(48)).mesh;
        let tube = self.offset("torus, shell", &ring, &shell(0.15))?;
        Ok(vec![
            self.drawn(&hollow, &self.cut(), "A cone, hollowed and cut open")?,
            self.drawn(&tube, &self.cut(), "A torus, hollowed and cut open")?,
            self.drawn(&shrunk, &self.look(), "The comb, shrunk by 0.025")?,
        ])
    }

    fn soup(&mut self) -> Result<Vec<Figure>, JobError> {
        let plates = crossing_plates(2.0).mesh;
        let params = OffsetParams {
            distance: 0.25,
            tolerance: self.detail.length(0.01),
            ..OffsetParams::default()
        };
        let padded = self.offset("crossing plates, both", &plates, &params)?;
        Ok(vec![
            self.drawn(&plates, &self.look(), "Two plates that cross, no solid")?,
            self.drawn(
                &padded,
                &self.look(),
                "The solid whose surface is 0.25 away from them",
            )?,
        ])
    }

    /// The offset whose cells and errors are shown.
    fn grown(&self) -> OffsetParams {
        OffsetParams {
            distance: 0.1,
            tolerance: self.detail.length(0.005),
            side: Side::Outer,
            ..OffsetParams::default()
        }
    }

    fn cells(&mut self, report: &mut Report) -> Result<Vec<Figure>, JobError> {
        let cells = offset_cells(&fins(), &self.grown(), self.progress).map_err(refused)?;
        report.figures.insert("offset_cells", cells.len() as f64);
        // those behind a plane, so that the inside is seen, too
        let behind = |cell: &&OffsetCell| cell.bounds.max.y > 0.0;
        let open: Vec<OffsetCell> = cells.iter().filter(behind).copied().collect();
        let on_plane = |cell: &&OffsetCell| cell.bounds.min.y <= 0.0;
        let slice: Vec<OffsetCell> = open.iter().filter(on_plane).copied().collect();
        let levels = cells.iter().map(|cell| f64::from(cell.level));
        let [low, high] = levels.fold([f64::INFINITY, 0.0], |[low, high], level: f64| {
            [low.min(level), high.max(level)]
        });
        let lines = RenderParams {
            features: Some(FeatureLines {
                angle_deg: 45.0,
                silhouettes: true,
                style: LineStyle {
                    color: [24, 28, 34],
                    width_px: 0.5,
                },
            }),
            smooth_angle_deg: 0.0,
            ..self.look()
        };
        let front = RenderParams {
            camera: Camera {
                view: View::FRONT,
                ..Camera::default()
            },
            ..lines.clone()
        };
        let mut figures = Vec::new();
        for (cells, look, caption) in [
            (
                &cells,
                &lines,
                format!(
                    "The {} cells of the octree that the surface passes",
                    cells.len()
                ),
            ),
            (&open, &lines, "The same, cut open".to_owned()),
            (&slice, &front, "Those in the plane of the cut".to_owned()),
        ] {
            let (mesh, levels) = boxes(cells);
            let paint = Paint::VertexValues(Values {
                values: &levels,
                map: ColorMap::Sequential,
                // without the darkest colors, on which lines could not be seen
                range: Some([low - 1.0, high]),
            });
            figures.push(drawn(&mesh, &paint, look, caption, self.progress)?);
        }
        Ok(figures)
    }

    fn exactness(&mut self, report: &mut Report) -> Result<Vec<Figure>, JobError> {
        let fins = fins();
        let merged = self.grown();
        let found = OffsetParams {
            simplify: false,
            ..merged.clone()
        };
        let raw = self.offset("comb, outer, not merged", &fins, &found)?;
        let mesh = self.offset("comb, outer, merged", &fins, &merged)?;
        let triangles = mesh.triangles().len();
        let edges = RenderParams {
            wireframe: Some(LineStyle {
                color: [40, 44, 52],
                width_px: 0.5,
            }),
            smooth_angle_deg: 0.0,
            features: None,
            ..self.look()
        };
        let mut figures = vec![
            self.drawn(
                &raw,
                &edges,
                &format!("As found: {} triangles", raw.triangles().len()),
            )?,
            self.drawn(&mesh, &edges, &format!("Merged: {triangles} triangles"))?,
        ];
        let diagonal = fins.bounds().diagonal();
        let coarse = self.detail.coarsely_refined(mesh.clone(), diagonal);
        let fine = self.detail.refined(mesh, diagonal);
        let bvh = Bvh::new(&fins);
        let errors = |mesh: &TriMesh| {
            let values = vertex_distances(mesh, &bvh, self.progress)?;
            let errors = values.iter().map(|value| value - merged.distance);
            Ok::<Vec<f64>, JobError>(errors.collect())
        };
        let (values, few) = (errors(&fine)?, errors(&coarse)?);
        let largest = values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        let [picture, solid] = [&values, &few].map(|values| {
            Paint::VertexValues(Values {
                values,
                map: ColorMap::Diverging,
                range: Some([-merged.tolerance, merged.tolerance]),
            })
        });
        let figure = pictured(
            &fine,
            &picture,
            &self.look(),
            "Its error, in colors",
            self.progress,
        )?;
        let solid = Solid::new(&coarse, &solid, &self.look(), self.progress)?;
        figures.push(figure.with_solid(solid).with_note(format!(
            "at most {:.0} % of the tolerance",
            100.0 * largest / merged.tolerance
        )));
        report.figures.extend([
            ("offset_triangles", triangles as f64),
            ("offset_error_percent", 100.0 * largest / merged.tolerance),
        ]);
        Ok(figures)
    }
}

/// A length with as many digits as it has, up to six after the point.
fn rounded(length: f64) -> String {
    ((1e6 * length).round() / 1e6).to_string()
}

fn fins() -> TriMesh {
    comb(4, 0.12, 0.3, 0.8).mesh
}

/// Why there is no offset; the parameters of this page are constants.
fn refused(error: OffsetError) -> JobError {
    match error {
        OffsetError::Cancelled(_) => JobError::Cancelled,
        other => bug("the offset of a solid", &other),
    }
}

/// Cells as boxes, and the level of each at its corners.
fn boxes(cells: &[OffsetCell]) -> (TriMesh, Vec<f64>) {
    let unit = cuboid(DVec3::ONE).mesh;
    let middle = unit.bounds().center();
    let (mut positions, mut triangles, mut levels) = (Vec::new(), Vec::new(), Vec::new());
    for cell in cells {
        let first = positions.len() as u32;
        let (center, size) = (cell.bounds.center(), cell.bounds.size());
        let corners = unit.positions().iter();
        positions.extend(corners.map(|&p| center + size * (p - middle)));
        levels.resize(positions.len(), f64::from(cell.level));
        let sides = unit.triangles().iter();
        triangles.extend(sides.map(|t| t.map(|v| v + first)));
    }
    let mesh = TriMesh::new(positions, triangles);
    (mesh.expect("corners of finite boxes have numbers"), levels)
}
