//! The part of the demonstration that is about offsets: of solids drawn by formulas, and of a soup.

use crate::error::JobError;
use crate::gallery::{Figure, Gallery};
use crate::mesh::refine::refined;
use crate::mesh::showcase::{bug, drawn, small};
use crate::report::Report;
use glam::DVec3;
use ravec::mesh::render::{
    Camera, ColorMap, LineStyle, Paint, RenderParams, Section, Values, View,
};
use ravec::mesh::{Bvh, TriMesh, vertex_distances};
use ravec::offset::{Offset, OffsetError, OffsetParams, Side, offset};
use ravec::progress::Progress;
use ravec_scenes::solids::{comb, cone, crossing_plates, torus};

/// Puts the section about offsets on the page.
///
/// Figures: `offset_triangles` of the offset in colors, `offset_error_percent`, the largest error at the vertices of a fine
/// subdivision of it in percent of its tolerance, and `offset_proved` (0 or 1), whether all results of the section are.
pub(crate) fn show(
    page: &mut Gallery,
    report: &mut Report,
    progress: &Progress,
) -> Result<(), JobError> {
    page.section(
        "Offsets",
        "What lies at a distance from any triangles: closed, free of intersections, with sharp creases, and proved to be \
         within the tolerance.",
    );
    let mut studio = Studio {
        rows: Vec::new(),
        proved: true,
        progress,
    };
    page.figures(&studio.growth()?);
    page.figures(&studio.insides()?);
    page.figures(&studio.soup()?);
    page.paragraph(
        "The same surface before and after its triangles are merged: cells are small only where the surface is curved or \
         creased. Colors show how far it is off, from blue (too near, by the whole tolerance) to red (too far).",
    );
    let figures = studio.exactness(report)?;
    page.figures(&figures);
    page.table(
        &[
            "offset",
            "distance",
            "tolerance",
            "triangles found",
            "triangles",
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
        let Offset { mesh, report } =
            offset(mesh, params, self.progress).map_err(|error| match error {
                OffsetError::Cancelled(_) => JobError::Cancelled,
                other => bug("the offset of a solid", &other),
            })?;
        let proved = report.certified && report.solid;
        self.proved &= proved;
        self.rows.push(vec![
            name.to_owned(),
            params.distance.to_string(),
            params.tolerance.to_string(),
            report.extracted_triangles.to_string(),
            report.triangles.to_string(),
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

    fn growth(&mut self) -> Result<Vec<Figure>, JobError> {
        let fins = fins();
        let mut figures = vec![self.drawn(&fins, &look(), "a comb")?];
        for distance in [0.05, 0.15, 0.4] {
            let params = OffsetParams {
                distance,
                tolerance: 0.01,
                side: Side::Outer,
                ..OffsetParams::default()
            };
            let grown = self.offset("comb, outer", &fins, &params)?;
            figures.push(self.drawn(&grown, &look(), &format!("grown by {distance}"))?);
        }
        Ok(figures)
    }

    fn insides(&mut self) -> Result<Vec<Figure>, JobError> {
        let shell = |distance| OffsetParams {
            distance,
            tolerance: 0.005,
            side: Side::Shell,
            ..OffsetParams::default()
        };
        let hat = cone(1.0, 2.0, 72).mesh;
        let hollow = self.offset("cone, shell", &hat, &shell(0.12))?;
        let inner = OffsetParams {
            side: Side::Inner,
            ..shell(0.025)
        };
        let shrunk = self.offset("comb, inner", &fins(), &inner)?;
        let ring = torus(2.0, 0.8, 96, 48).mesh;
        let tube = self.offset("torus, shell", &ring, &shell(0.15))?;
        Ok(vec![
            self.drawn(&hollow, &cut(-DVec3::Y), "a cone, hollowed and cut open")?,
            self.drawn(&tube, &cut(-DVec3::Y), "a torus, hollowed and cut open")?,
            self.drawn(&shrunk, &look(), "the comb, shrunk by 0.025")?,
        ])
    }

    fn soup(&mut self) -> Result<Vec<Figure>, JobError> {
        let plates = crossing_plates(2.0).mesh;
        let params = OffsetParams {
            distance: 0.25,
            tolerance: 0.01,
            ..OffsetParams::default()
        };
        let padded = self.offset("crossing plates, both", &plates, &params)?;
        Ok(vec![
            self.drawn(&plates, &look(), "two plates, no solid")?,
            self.drawn(&padded, &look(), "what is 0.25 away from them")?,
        ])
    }

    fn exactness(&mut self, report: &mut Report) -> Result<Vec<Figure>, JobError> {
        let fins = fins();
        let merged = OffsetParams {
            distance: 0.15,
            tolerance: 0.004,
            side: Side::Outer,
            ..OffsetParams::default()
        };
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
            ..look()
        };
        let mut figures = vec![
            self.drawn(
                &raw,
                &edges,
                &format!("{} triangles", raw.triangles().len()),
            )?,
            self.drawn(&mesh, &edges, &format!("{triangles} triangles"))?,
        ];
        let fine = refined(mesh, fins.bounds().diagonal() / 120.0, 200_000);
        let mut values = vertex_distances(&fine, &Bvh::new(&fins), self.progress)?;
        for value in &mut values {
            *value -= merged.distance;
        }
        let largest = values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        let paint = Paint::VertexValues(Values {
            values: &values,
            map: ColorMap::Diverging,
            range: Some([-merged.tolerance, merged.tolerance]),
        });
        figures.push(drawn(&fine, &paint, &look(), "its error", self.progress)?);
        report.figures.extend([
            ("offset_triangles", triangles as f64),
            ("offset_error_percent", 100.0 * largest / merged.tolerance),
        ]);
        Ok(figures)
    }
}

fn fins() -> TriMesh {
    comb(4, 0.12, 0.3, 0.8).mesh
}

fn look() -> RenderParams {
    RenderParams {
        camera: Camera {
            view: View::new(30.0, 30.0),
            ..Camera::default()
        },
        ..small()
    }
}

/// Cut through the middle, seen from the side that is taken away.
fn cut(normal: DVec3) -> RenderParams {
    RenderParams {
        section: Some(Section {
            normal,
            offset: 0.0,
            capped: true,
        }),
        ..small()
    }
}
