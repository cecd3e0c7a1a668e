//! The part of the demonstration that is about expressions over meshes.

use super::{Detail, drawn};
use crate::error::bug;
use crate::page::{Figure, Gallery};
use glam::DVec3;
use ravec::boolean::{Boolean, BooleanError, BooleanParams, Expr, boolean};
use ravec::mesh::TriMesh;
use ravec::mesh_render::{Camera, Paint, RenderParams, View};
use ravec::progress::Progress;
use ravec_jobs::JobError;
use ravec_jobs::Report;
use ravec_jobs::mesh::boolean::{origin_colors, with_seams};
use ravec_scenes::Seed;
use ravec_scenes::solids::{boulder, cone, cuboid, cylinder, icosphere, with_holes};

/// Puts the section about expressions on the page.
///
/// Figures: `boolean_solid` (0 or 1), whether all results of the section are closed, manifold and free of self-intersections,
/// and `boolean_kept_percent`, of the triangles of a scan without a box, those that are as they were.
pub fn show(
    page: &mut Gallery,
    report: &mut Report,
    seed: Seed,
    detail: Detail,
    progress: &Progress,
) -> Result<(), JobError> {
    page.section(
        "Solids by expressions",
        "Meshes combined by union, intersection and difference: parts from simple shapes, holes in scans. Surfaces meet exactly, \
         without a gap. Blue triangles are as they were, orange ones are pieces of one, green ones close a hole; red lines are \
         where surfaces meet.",
    );
    let mut studio = Studio {
        rows: Vec::new(),
        solid: true,
        detail,
        progress,
    };
    let mut figures = studio.part()?;
    figures.extend(studio.pattern()?);
    page.figures(&figures);
    page.paragraph(
        "A scan has many small triangles, and only those along the cut change. One with holes is no solid; it is closed first, and \
         the report says where.",
    );
    let (figures, assumptions) = studio.scans(seed, report)?;
    page.figures(&figures);
    for assumption in assumptions {
        page.paragraph(&format!("Assumed about the scan with holes: {assumption}."));
    }
    let figures = studio.spheres(seed)?;
    page.figures(&figures);
    page.table(
        &[
            "expression",
            "meshes",
            "triangles before",
            "triangles",
            "as they were",
            "edges where surfaces meet",
            "volume",
            "solid",
        ],
        &studio.rows,
    );
    let solid = f64::from(u8::from(studio.solid));
    report.figures.insert("boolean_solid", solid);
    Ok(())
}

struct Studio<'a> {
    rows: Vec<Vec<String>>,
    solid: bool,
    detail: Detail,
    progress: &'a Progress,
}

impl Studio<'_> {
    /// The value of an expression, as a row of the table.
    fn combined(
        &mut self,
        text: &str,
        expr: &Expr,
        meshes: &[TriMesh],
    ) -> Result<Boolean, JobError> {
        let params = BooleanParams::default();
        let result =
            boolean(meshes, expr, &params, self.progress).map_err(|error| match error {
                BooleanError::Cancelled => JobError::Cancelled,
                other => bug("an expression over solids", &other),
            })?;
        self.solid &= result.report.solid;
        let before: usize = meshes.iter().map(|mesh| mesh.triangles().len()).sum();
        self.rows.push(vec![
            text.to_owned(),
            meshes.len().to_string(),
            before.to_string(),
            result.report.triangles.to_string(),
            result.report.kept_triangles.to_string(),
            result.feature_edges.len().to_string(),
            format!("{:.4}", result.report.volume),
            if result.report.solid { "yes" } else { "no" }.to_owned(),
        ]);
        Ok(result)
    }

    fn view(&self, azimuth_deg: f64, elevation_deg: f64) -> RenderParams {
        RenderParams {
            camera: Camera {
                view: View::new(azimuth_deg, elevation_deg),
                ..Camera::default()
            },
            ..self.detail.picture()
        }
    }

    fn drawn(
        &self,
        result: &Boolean,
        view: &RenderParams,
        caption: &str,
    ) -> Result<Figure, JobError> {
        let colors = origin_colors(&result.origins);
        let look = with_seams(result, 1.5, view);
        let paint = Paint::FaceColors(&colors);
        drawn(&result.mesh, &paint, &look, caption, self.progress)
    }

    /// A bracket of ten primitives.
    fn part(&mut self) -> Result<Vec<Figure>, JobError> {
        let around = self.detail.edges(64);
        let block = |size: [f64; 3], at: [f64; 3]| cuboid(size.into()).shifted(at.into()).mesh;
        let pin = |radius: f64, height: f64, at: [f64; 3]| {
            cylinder(radius, height, around).shifted(at.into()).mesh
        };
        // with another number of sides than the boss, as holes of another size have
        let bore = cylinder(0.5, 4.0, self.detail.edges(46)).mesh;
        let hole = |x: f64, y: f64| pin(0.18, 1.0, [x, y, 0.0]);
        let primitives = [
            ("base", block([4.0, 2.4, 0.4], [0.0; 3])),
            ("boss", pin(0.8, 1.6, [0.0, 0.0, 0.6])),
            ("rib", block([3.0, 0.24, 0.8], [0.0, 0.0, 0.5])),
            ("rib2", block([0.24, 2.0, 0.8], [0.0, 0.0, 0.5])),
            ("bore", bore),
            ("slot", lying(&pin(0.2, 3.0, [0.0; 3]), 1.0)),
            ("h1", hole(-1.6, -0.8)),
            ("h2", hole(1.6, -0.8)),
            ("h3", hole(-1.6, 0.8)),
            ("h4", hole(1.6, 0.8)),
        ];
        let text = "base | boss | rib | rib2 - bore - slot - (h1 | h2 | h3 | h4)";
        let (names, meshes): (Vec<_>, Vec<_>) = primitives.into_iter().unzip();
        let expr = Expr::parse_with(text, &names).map_err(|error| bug("an expression", &error))?;
        let result = self.combined(text, &expr, &meshes)?;
        Ok(vec![
            drawn(
                &together(&meshes),
                &Paint::Plain,
                &self.view(30.0, 30.0),
                "Ten simple shapes that overlap",
                self.progress,
            )?,
            self.drawn(
                &result,
                &self.view(30.0, 30.0),
                "The bracket that one expression makes of them",
            )?
            .with_note(text),
        ])
    }

    /// A plate with many holes at once.
    fn pattern(&mut self) -> Result<Vec<Figure>, JobError> {
        let around = self.detail.edges(32);
        let mut meshes = vec![cuboid(DVec3::new(4.0, 2.8, 0.3)).mesh];
        for column in 0..10 {
            for row in 0..7 {
                let at = DVec3::new(
                    0.38 * f64::from(column - 5) + 0.19,
                    0.38 * f64::from(row - 3),
                    0.0,
                );
                meshes.push(cylinder(0.13, 1.0, around).shifted(at).mesh);
            }
        }
        let expr = Expr::Difference((0..meshes.len()).map(Expr::Mesh).collect());
        let result = self.combined("plate - 70 drills", &expr, &meshes)?;
        let view = self.view(25.0, 40.0);
        Ok(vec![self.drawn(
            &result,
            &view,
            "A plate without 70 drills, all at once",
        )?])
    }

    /// A scan without a box, and one with holes on a stand; also what was assumed about the latter.
    fn scans(
        &mut self,
        seed: Seed,
        report: &mut Report,
    ) -> Result<(Vec<Figure>, Vec<String>), JobError> {
        let divisions = if self.detail.edges(64) > 40 { 6 } else { 4 };
        let scan = boulder(divisions, seed);
        let corner = cuboid(DVec3::ONE).shifted(DVec3::new(0.6, -0.6, 0.6)).mesh;
        let expr = Expr::Difference(vec![Expr::Mesh(0), Expr::Mesh(1)]);
        let bitten = self.combined("scan - box", &expr, &[scan.clone(), corner])?;
        let kept = bitten.report.kept_triangles as f64;
        let share = 100.0 * kept / bitten.report.triangles.max(1) as f64;
        report.figures.insert("boolean_kept_percent", share);
        let holes = [
            DVec3::new(0.1, -1.0, 0.3),
            DVec3::new(0.8, -0.6, -0.3),
            DVec3::new(-0.6, -0.6, 0.6),
            DVec3::new(0.0, 0.0, -1.0),
        ];
        let open = with_holes(&scan, &holes, 0.24);
        let stand = [
            cone(1.0, 1.4, self.detail.edges(64))
                .shifted(-1.4 * DVec3::Z)
                .mesh,
            cylinder(1.1, 0.3, self.detail.edges(78))
                .shifted(-1.5 * DVec3::Z)
                .mesh,
        ];
        let [spire, foot] = stand;
        let expr = Expr::Union((0..3).map(Expr::Mesh).collect());
        let meshes = [open.clone(), spire, foot];
        let standing = self.combined("scan with holes | cone | foot", &expr, &meshes)?;
        let view = || self.view(20.0, 15.0);
        let figures = vec![
            self.drawn(
                &bitten,
                &self.view(30.0, 30.0),
                "A scan from which a box was taken: all other triangles are as they were",
            )?,
            drawn(
                &open,
                &Paint::Plain,
                &view(),
                "A scan with holes, which is no solid",
                self.progress,
            )?,
            self.drawn(
                &standing,
                &view(),
                "The same, closed and united with a stand",
            )?,
        ];
        Ok((figures, standing.report.operands[0].assumptions.clone()))
    }

    /// A hundred balls at random places.
    fn spheres(&mut self, seed: Seed) -> Result<Vec<Figure>, JobError> {
        let divisions = if self.detail.edges(64) > 40 { 3 } else { 2 };
        let balls: Vec<TriMesh> = (0..100)
            .map(|ball| {
                let at = [0, 1, 2].map(|axis| seed.between(ball, axis, 0, -1.0, 1.0));
                let radius = seed.between(ball, 3, 0, 0.16, 0.36);
                icosphere(radius, divisions).shifted(at.into()).mesh
            })
            .collect();
        let all = || (0..balls.len()).map(Expr::Mesh).collect();
        let union = self.combined("union of 100 balls", &Expr::Union(all()), &balls)?;
        let odd = Expr::SymmetricDifference(all());
        let odd = Expr::Intersection(vec![odd, Expr::Mesh(balls.len())]);
        let half = cuboid(DVec3::new(3.0, 1.5, 3.0))
            .shifted(0.75 * DVec3::Y)
            .mesh;
        let meshes = [&balls[..], &[half]].concat();
        let odd = self.combined("symmetric difference of 100 balls & box", &odd, &meshes)?;
        Ok(vec![
            self.drawn(
                &union,
                &self.view(30.0, 30.0),
                "The union of a hundred balls",
            )?,
            self.drawn(
                &odd,
                &self.view(10.0, 10.0),
                "The space in an odd number of them, cut open by a box",
            )?,
        ])
    }
}

/// A mesh with z along y instead, at a height.
fn lying(mesh: &TriMesh, height: f64) -> TriMesh {
    let turned = mesh
        .positions()
        .iter()
        .map(|p| DVec3::new(p.x, -p.z, p.y + height));
    let turned = TriMesh::new(turned.collect(), mesh.triangles().to_vec());
    turned.expect("a turned mesh has the same vertices")
}

/// All triangles as one mesh.
fn together(meshes: &[TriMesh]) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for mesh in meshes {
        let first = positions.len() as u32;
        positions.extend_from_slice(mesh.positions());
        triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + first)));
    }
    let all = TriMesh::new(positions, triangles);
    all.expect("triangles name vertices of their own mesh")
}
