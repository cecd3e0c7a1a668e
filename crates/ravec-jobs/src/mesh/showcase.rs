//! The part of the demonstration that is about meshes: solids drawn by formulas, checked, cut open and simplified.

use super::check::{Params as CheckList, findings};
use super::refine::refined;
use super::render::image_of;
use crate::error::JobError;
use crate::gallery::{Figure, Gallery};
use crate::report::Report;
use glam::DVec3;
use ravec::mesh::{
    Bvh, CheckParams, HausdorffError, HausdorffParams, Keep, SimplifyError, SimplifyParams,
    TriMesh, check, hausdorff, simplify, vertex_distances,
};
use ravec::mesh_render::{
    Camera, ColorMap, LineStyle, Paint, RenderError, RenderParams, Section, Values, View, render,
};
use ravec::progress::Progress;
use ravec_scenes::Seed;
use ravec_scenes::solids::{all, comb, torus};

/// Puts the sections about meshes on the page.
///
/// Figures: `simplified_triangles`, of a torus, and `simplified_distance_percent`, the proven largest distance between the
/// two in percent of the diagonal.
pub(crate) fn show(
    page: &mut Gallery,
    report: &mut Report,
    seed: Seed,
    detail: Detail,
    progress: &Progress,
) -> Result<(), JobError> {
    checks(page, seed, detail, progress)?;
    cuts(page, detail, progress)?;
    simplification(page, report, detail, progress)
}

/// How large the pictures of meshes are, and how fine what they show.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Detail {
    /// The side of a picture as a share of that of a large page, 0.25 to 1.
    share: f64,
}

impl Detail {
    /// Settings for a page whose pictures have sides up to `max_side`. From 640 on nothing is spared.
    pub fn of(max_side: usize) -> Self {
        Self {
            share: (max_side as f64 / 640.0).clamp(0.25, 1.0),
        }
    }

    /// Settings common to all pictures.
    pub(super) fn picture(self) -> RenderParams {
        let side = |px: f64| (px * self.share) as u32;
        RenderParams {
            width: side(420.0),
            height: side(320.0),
            background: None,
            ..RenderParams::default()
        }
    }

    /// A length below which nothing can be seen, given for large pictures.
    pub(super) fn length(self, fine: f64) -> f64 {
        fine / self.share
    }

    /// A number of edges around something round, given for large pictures.
    pub(super) fn edges(self, fine: u32) -> u32 {
        (f64::from(fine) * self.share.sqrt()) as u32
    }

    /// A mesh with triangles so small that colors at their corners show what happens between them.
    pub(super) fn refined(self, mesh: TriMesh, diagonal: f64) -> TriMesh {
        let longest = self.length(diagonal / 120.0);
        refined(mesh, longest, 200_000, &Progress::none()).expect("nobody can cancel it")
    }
}

pub(super) fn drawn(
    mesh: &TriMesh,
    paint: &Paint<'_>,
    params: &RenderParams,
    caption: impl Into<String>,
    progress: &Progress,
) -> Result<Figure, JobError> {
    let rendering = render(mesh, paint, params, progress).map_err(|error| match error {
        RenderError::Cancelled(_) => JobError::Cancelled,
        other => bug("the picture of a solid", &other),
    })?;
    Ok(Figure::picture(&image_of(rendering).convert(), caption))
}

/// The parameters of this page are constants.
pub(super) fn bug(name: &'static str, error: &impl std::fmt::Display) -> JobError {
    JobError::Parameter {
        name,
        value: error.to_string(),
        range: "possible",
    }
}

fn checks(
    page: &mut Gallery,
    seed: Seed,
    detail: Detail,
    progress: &Progress,
) -> Result<(), JobError> {
    page.section(
        "Meshes",
        "Solids and sheets with closed formulas, checked by exact arithmetic. The back of a surface is red; so are triangles \
         that intersect others.",
    );
    let red = [210, 40, 40];
    let plain = RenderParams::default().front_color;
    let (mut figures, mut rows) = (Vec::new(), Vec::new());
    for solid in all(seed) {
        let mesh = &solid.mesh;
        let asked = CheckParams {
            list_limit: mesh.triangles().len(),
            ..CheckParams::default()
        };
        let found = check(mesh, &asked, progress)?;
        let mut colors = vec![plain; mesh.triangles().len()];
        let pairs = found.self_intersections.as_ref();
        for pair in pairs.iter().flat_map(|pairs| &pairs.pairs) {
            colors[pair.first as usize] = red;
            colors[pair.second as usize] = red;
        }
        let paint = if pairs.is_some_and(|pairs| pairs.count > 0) {
            Paint::FaceColors(&colors)
        } else {
            Paint::Plain
        };
        figures.push(drawn(
            mesh,
            &paint,
            &detail.picture(),
            solid.name,
            progress,
        )?);
        let defects = findings(mesh, &found, &CheckList::default());
        let defects = defects.iter().filter(|finding| finding.defect);
        let defects: Vec<_> = defects
            .map(|finding| format!("{} {}", finding.count, finding.what))
            .collect();
        rows.push(vec![
            solid.name.to_owned(),
            mesh.triangles().len().to_string(),
            found.components.to_string(),
            found.genus.map_or(String::new(), |genus| genus.to_string()),
            if defects.is_empty() {
                "none".to_owned()
            } else {
                defects.join(", ")
            },
        ]);
    }
    page.figures(&figures);
    let head = ["mesh", "triangles", "parts", "handles", "defects"];
    page.table(&head, &rows);
    Ok(())
}

fn cuts(page: &mut Gallery, detail: Detail, progress: &Progress) -> Result<(), JobError> {
    page.paragraph("Cut open, as a solid and as a shell, and with the edges of all triangles.");
    let ring = torus(2.0, 0.8, detail.edges(96), detail.edges(48)).mesh;
    let fins = comb(6, 0.06, 0.2, 1.0).mesh;
    let cut = |normal: DVec3, offset, capped| RenderParams {
        section: Some(Section {
            normal,
            offset,
            capped,
        }),
        ..detail.picture()
    };
    let edges = RenderParams {
        wireframe: Some(LineStyle {
            color: [60, 66, 76],
            width_px: 0.6,
        }),
        camera: Camera {
            view: View::new(25.0, 20.0),
            ..Camera::default()
        },
        ..detail.picture()
    };
    let figures = [
        drawn(
            &ring,
            &Paint::Plain,
            &cut(-DVec3::Y, 0.0, true),
            "a torus, cut as a solid",
            progress,
        )?,
        drawn(
            &ring,
            &Paint::Plain,
            &cut(-DVec3::Y, 0.0, false),
            "the same as a shell",
            progress,
        )?,
        drawn(
            &fins,
            &Paint::Plain,
            &cut(DVec3::X, 0.3, true),
            "a comb, cut through its fins",
            progress,
        )?,
        drawn(&ring, &Paint::Plain, &edges, "edges of triangles", progress)?,
    ];
    page.figures(&figures);
    Ok(())
}

fn simplification(
    page: &mut Gallery,
    report: &mut Report,
    detail: Detail,
    progress: &Progress,
) -> Result<(), JobError> {
    page.section(
        "Fewer triangles",
        "A torus is simplified while it stays closed and free of intersections. Colors show how far the result is from the \
         original, from violet (nothing) to yellow (the distance in the table, which is proven for every point of both \
         surfaces).",
    );
    let ring = torus(2.0, 0.8, detail.edges(128), detail.edges(72)).mesh;
    let bvh = Bvh::new(&ring);
    let diagonal = ring.bounds().diagonal();
    let edges = RenderParams {
        wireframe: Some(LineStyle {
            color: [40, 44, 52],
            width_px: 0.5,
        }),
        smooth_angle_deg: 0.0,
        features: None,
        ..detail.picture()
    };
    let (mut figures, mut rows) = (Vec::new(), Vec::new());
    for target in [4000, 1000, 250] {
        let params = SimplifyParams {
            target_triangles: target,
            ..SimplifyParams::default()
        };
        let simple = simplify(&ring, &params, &Keep::default(), |_| false, progress);
        let mesh = match simple {
            Ok(simple) => simple.mesh,
            Err(SimplifyError::Cancelled(_)) => return Err(JobError::Cancelled),
            Err(other) => return Err(bug("the simplification", &other)),
        };
        let asked = HausdorffParams {
            tolerance: detail.length(2e-4 * diagonal),
            samples: 20_000,
            ..HausdorffParams::default()
        };
        let apart = hausdorff(&ring, &mesh, &asked, progress).map_err(|error| match error {
            HausdorffError::Cancelled(_) => JobError::Cancelled,
            other => bug("the distance of two solids", &other),
        })?;
        let percent = |length: f64| 100.0 * length / diagonal;
        let triangles = mesh.triangles().len();
        if target == 1000 {
            report.figures.extend([
                ("simplified_triangles", triangles as f64),
                ("simplified_distance_percent", percent(apart.upper())),
            ]);
        }
        rows.push(vec![
            triangles.to_string(),
            format!(
                "{:.3} to {:.3} %",
                percent(apart.lower()),
                percent(apart.upper())
            ),
            format!("{:.4} %", percent(apart.forward.mean)),
        ]);
        let caption = format!("{triangles} triangles");
        figures.push(drawn(&mesh, &Paint::Plain, &edges, caption, progress)?);
        let fine = detail.refined(mesh, diagonal);
        let values = vertex_distances(&fine, &bvh, progress)?;
        let paint = Paint::VertexValues(Values {
            values: &values,
            map: ColorMap::Sequential,
            range: Some([0.0, apart.upper()]),
        });
        figures.push(drawn(
            &fine,
            &paint,
            &detail.picture(),
            "its distance",
            progress,
        )?);
    }
    page.figures(&figures);
    page.table(
        &[
            "triangles",
            "largest distance, of the diagonal",
            "mean distance",
        ],
        &rows,
    );
    Ok(())
}
