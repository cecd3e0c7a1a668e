//! Sections about meshes: solids drawn by formulas, checked, cut open and simplified.

pub mod booleans;
pub mod offsets;

use crate::error::bug;
use crate::page::{Figure, Gallery, MAX_TRIANGLES, Solid};
use glam::DVec3;
use ravec::mesh::{
    Bvh, CheckParams, HausdorffError, HausdorffParams, Keep, SimplifyError, SimplifyParams,
    TriMesh, check, hausdorff, simplify, vertex_distances,
};
use ravec::mesh_render::{
    Camera, ColorMap, LineStyle, Paint, RenderError, RenderParams, Section, Values, View, render,
};
use ravec::progress::Progress;
use ravec_jobs::mesh::check::{Params as CheckList, findings};
use ravec_jobs::mesh::refined;
use ravec_jobs::mesh::render::image_of;
use ravec_jobs::{JobError, Report};
use ravec_scenes::Seed;
use ravec_scenes::solids::{all, comb, torus};

/// Puts the sections about meshes on the page.
///
/// Figures: `simplified_triangles`, of a torus, and `simplified_distance_percent`, the proven largest distance between the
/// two in percent of the diagonal.
pub fn show(
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

/// The size of pictures of meshes, and the fineness of the meshes.
#[derive(Debug, Clone, Copy)]
pub struct Detail {
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
    pub fn picture(self) -> RenderParams {
        let side = |px: f64| (px * self.share) as u32;
        RenderParams {
            width: side(420.0),
            height: side(320.0),
            background: None,
            ..RenderParams::default()
        }
    }

    /// A length below which nothing can be seen, given for large pictures.
    pub fn length(self, fine: f64) -> f64 {
        fine / self.share
    }

    /// A number of edges around something round, given for large pictures.
    pub fn edges(self, fine: u32) -> u32 {
        (f64::from(fine) * self.share.sqrt()) as u32
    }

    /// A mesh with triangles so small that colors at their corners show what happens between them.
    pub fn refined(self, mesh: TriMesh, diagonal: f64) -> TriMesh {
        let longest = self.length(diagonal / 120.0);
        refined(mesh, longest, 200_000, &Progress::none()).expect("nobody can cancel it")
    }

    /// The same for the viewer of the page, which takes fewer triangles.
    pub fn coarsely_refined(self, mesh: TriMesh, diagonal: f64) -> TriMesh {
        let longest = self.length(diagonal / 120.0);
        // edges are halved in rounds, and a round that makes too many triangles is left out: other lengths fill the limit better
        let tried = [1.0, 1.2, 1.4, 1.6, 1.8].map(|factor| {
            let mesh = refined(
                mesh.clone(),
                factor * longest,
                MAX_TRIANGLES,
                &Progress::none(),
            );
            mesh.expect("nobody can cancel it")
        });
        let largest = tried.into_iter().max_by_key(|mesh| mesh.triangles().len());
        largest.unwrap_or(mesh)
    }
}

/// Draws a mesh, for readers to turn.
pub fn drawn(
    mesh: &TriMesh,
    paint: &Paint<'_>,
    params: &RenderParams,
    caption: impl Into<String>,
    progress: &Progress,
) -> Result<Figure, JobError> {
    let solid = Solid::new(mesh, paint, params, progress)?;
    Ok(pictured(mesh, paint, params, caption, progress)?.with_solid(solid))
}

/// Draws a mesh, as a picture alone.
pub fn pictured(
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

fn checks(
    page: &mut Gallery,
    seed: Seed,
    detail: Detail,
    progress: &Progress,
) -> Result<(), JobError> {
    page.section(
        "Checked meshes",
        "Solids and sheets drawn by formulas, each with or without a defect, as files for printing and simulation have them. \
         Exact arithmetic finds what is wrong and where. The back of a surface is red; so are triangles that intersect others.",
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
        let defects = findings(mesh, &found, &CheckList::default());
        let defects = defects.iter().filter(|finding| finding.defect);
        let defects: Vec<_> = defects
            .map(|finding| format!("{} {}", finding.count, finding.what))
            .collect();
        let summary = if defects.is_empty() {
            "none".to_owned()
        } else {
            defects.join(", ")
        };
        let caption = format!("{}{}", solid.name[..1].to_uppercase(), &solid.name[1..]);
        let figure = drawn(mesh, &paint, &detail.picture(), caption, progress)?;
        let triangles = mesh.triangles().len();
        figures.push(figure.with_note(match defects.len() {
            0 => format!("{triangles} triangles, no defect"),
            1 => format!("{triangles} triangles, 1 kind of defect"),
            kinds => format!("{triangles} triangles, {kinds} kinds of defects"),
        }));
        rows.push(vec![
            solid.name.to_owned(),
            triangles.to_string(),
            found.components.to_string(),
            found.genus.map_or(String::new(), |genus| genus.to_string()),
            summary,
        ]);
    }
    page.figures(&figures);
    let head = ["mesh", "triangles", "parts", "handles", "defects"];
    page.table(&head, &rows);
    Ok(())
}

fn cuts(page: &mut Gallery, detail: Detail, progress: &Progress) -> Result<(), JobError> {
    page.paragraph(
        "Cuts show the inside, as that of a solid or as that of a shell; edges show the triangles.",
    );
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
            "A torus, cut as a solid",
            progress,
        )?,
        drawn(
            &ring,
            &Paint::Plain,
            &cut(-DVec3::Y, 0.0, false),
            "The same as a shell: the inside is red",
            progress,
        )?,
        drawn(
            &fins,
            &Paint::Plain,
            &cut(DVec3::X, 0.3, true),
            "A comb, cut through its fins",
            progress,
        )?,
        drawn(
            &ring,
            &Paint::Plain,
            &edges,
            "The edges of all triangles of the torus",
            progress,
        )?,
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
        "A torus is simplified, for faster drawing, sending and printing, while it stays closed and free of intersections. \
         Colors show how far the result is from the original, from violet (nothing) to yellow (the largest distance in the \
         table, which is proven for every point of both surfaces).",
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
        let caption = format!("The torus with {triangles} triangles");
        figures.push(drawn(&mesh, &Paint::Plain, &edges, caption, progress)?);
        let coarse = detail.coarsely_refined(mesh.clone(), diagonal);
        let fine = detail.refined(mesh, diagonal);
        let [picture, solid] = [&fine, &coarse].map(|mesh| vertex_distances(mesh, &bvh, progress));
        let (picture, solid) = (picture?, solid?);
        let [picture, solid] = [&picture, &solid].map(|values| {
            Paint::VertexValues(Values {
                values,
                map: ColorMap::Sequential,
                range: Some([0.0, apart.upper()]),
            })
        });
        let look = detail.picture();
        let caption = "Its distance from the original";
        let figure = pictured(&fine, &picture, &look, caption, progress)?;
        let solid = Solid::new(&coarse, &solid, &look, progress)?;
        figures.push(figure.with_solid(solid).with_note(format!(
            "at most {:.3} % of the diagonal",
            percent(apart.upper())
        )));
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
