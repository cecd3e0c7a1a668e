//! Tools for meshes: a panel with the figures of the result, defects to fly to, and error colors.

use super::{Desk, DraftFn, DraftJob, DraftView, Gesture, MeshHand, Tool};
use crate::assistant::{Assistant, Memory};
use crate::content::{Content, Kind, View};
use crate::document::{Edit, result_name};
use crate::engine::run_in_memory;
use crate::view::mesh::{MarkedPlace, ShownMesh, VertexValues};
use egui::Ui;
use glam::DVec3;
use ravec::mesh::{Bvh, vertex_distances};
use ravec::mesh_render::ColorMap;
use ravec::progress::Progress;
use ravec_jobs::mesh::{Length, offset::Drafts};
use ravec_jobs::{Context, Finding, Step};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Kind of the questions about defects.
const CHECK: &str = "mesh check";
/// Kind of what drafts of offsets share.
const DRAFTS: &str = "offset drafts";
/// Kind of the questions about distances to the input.
const ERRORS: &str = "mesh errors";

/// Distance from a place at which the camera stops, as a share of the diagonal of the mesh.
const FLIGHT: f64 = 0.05;

/// Places of a kind of defects that are listed.
const LISTED: usize = 50;

/// A tool that makes a mesh of a mesh.
pub(crate) struct MeshTool {
    pub operation: &'static str,
    pub label: &'static str,
    pub hint: &'static str,
    pub fields: fn() -> Map<String, Value>,
    /// True if an edit of the operation is one of this tool.
    pub made: fn(&Edit) -> bool,
    pub draft: Option<DraftFn>,
    /// The place to fly to in the next frame.
    pub(super) fly: Option<DVec3>,
    pub(super) shows_errors: bool,
    pub(super) shows_defects: bool,
    /// The result whose distances were asked for last.
    pub(super) asked: Option<Arc<str>>,
}

/// Defects of a mesh.
struct Checked {
    key: Arc<str>,
    findings: Result<Vec<Finding>, String>,
    marked: Option<Arc<ShownMesh>>,
}

/// A mesh with its distances to the input.
struct Colored {
    of: Arc<ShownMesh>,
    colored: Arc<ShownMesh>,
}

impl MeshTool {
    /// A tool that makes all edits of an operation.
    pub fn new(
        operation: &'static str,
        label: &'static str,
        hint: &'static str,
        fields: fn() -> Map<String, Value>,
    ) -> Self {
        Self {
            operation,
            label,
            hint,
            fields,
            made: |_| true,
            draft: None,
            fly: None,
            shows_errors: false,
            shows_defects: false,
            asked: None,
        }
    }

    /// Lists the defects of the result; the place that was clicked.
    fn defects_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>) {
        let Some(result) = &desk.snapshot.result else {
            return;
        };
        if ui.button("List defects").clicked() {
            self.shows_defects = true;
            let (content, view) = (result.content.clone(), result.view.clone());
            let key = desk.snapshot.key.clone();
            desk.assistant.ask(CHECK, move |_, progress| {
                Some(check(&content, &view, key, progress))
            });
        }
        let checked = desk.assistant.answer::<Checked>(CHECK);
        let Some(checked) = checked.filter(|checked| checked.key == desk.snapshot.key) else {
            return;
        };
        match &checked.findings {
            Err(reason) => {
                ui.colored_label(ui.visuals().error_fg_color, reason);
            }
            Ok(findings) if findings.is_empty() => {
                ui.label("No defects");
            }
            Ok(findings) => {
                for finding in findings {
                    let title = format!("{} {}", finding.count, finding.what);
                    egui::CollapsingHeader::new(title).show(ui, |ui| {
                        for (index, place) in finding.places.iter().enumerate() {
                            let [x, y, z] = place.at;
                            let name = format!("{}: {x:.4}, {y:.4}, {z:.4}", index + 1);
                            if ui.button(name).on_hover_text("Fly there").clicked() {
                                self.fly = Some(DVec3::from(place.at));
                            }
                        }
                    });
                }
            }
        }
    }
}

/// The defects of a mesh, and the mesh with marks at them.
fn check(content: &Content, view: &View, key: Arc<str>, progress: &Progress) -> Checked {
    let findings = findings(content, progress);
    let marked = match (&findings, view.mesh()) {
        (Ok(findings), Some(shown)) => {
            let places = findings.iter().flat_map(|finding| &finding.places);
            let marks = places.map(|place| match (&place.vertices[..], &place.triangles[..]) {
                (&[a, b], []) => MarkedPlace::Edge([a, b]),
                (_, &[triangle, ..]) => MarkedPlace::Triangle(triangle),
                _ => MarkedPlace::Point(place.at.into()),
            });
            let marks = marks.collect();
            Some(Arc::new(ShownMesh::clone(shown).with_marked(marks)))
        }
        _ => None,
    };
    Checked {
        key,
        findings,
        marked,
    }
}

fn findings(content: &Content, progress: &Progress) -> Result<Vec<Finding>, String> {
    let Some(mesh) = content.mesh() else {
        return Err("there is no mesh".to_owned());
    };
    let input = result_name(0);
    let step = json!({
        "operation": "mesh check",
        "input": input.to_str(),
        "params": {"list": LISTED},
    });
    let step: Step = serde_json::from_value(step).map_err(|error| error.to_string())?;
    let context = Context::new(progress).with_intermediates();
    context.insert_mesh(&input, mesh.clone());
    let report = step
        .operation()
        .run(&context)
        .map_err(|error| error.to_string())?;
    let found = report.findings.into_iter();
    Ok(found.filter(|finding| finding.count > 0).collect())
}

impl Tool for MeshTool {
    fn operation(&self) -> &'static str {
        self.operation
    }

    fn label(&self) -> &'static str {
        self.label
    }

    fn hint(&self) -> &'static str {
        self.hint
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Mesh]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        (self.fields)()
    }

    fn made(&self, edit: &Edit) -> bool {
        edit.operation == self.operation && (self.made)(edit)
    }

    fn draft(&self) -> Option<DraftFn> {
        self.draft
    }

    fn drafts_first(&self) -> bool {
        true
    }

    fn shown_mesh(
        &self,
        assistant: &Assistant,
        shown: Option<&Arc<ShownMesh>>,
    ) -> Option<Arc<ShownMesh>> {
        let shown = shown?;
        if self.shows_errors
            && let Some(colored) = assistant.answer::<Colored>(ERRORS)
            && Arc::ptr_eq(&colored.of, shown)
        {
            return Some(colored.colored.clone());
        }
        let checked = assistant.answer::<Checked>(CHECK)?;
        let marked = checked.marked.as_ref()?;
        (self.shows_defects && Arc::ptr_eq(&marked.mesh, &shown.mesh)).then(|| marked.clone())
    }

    fn mesh_ui(&mut self, hand: MeshHand<'_>, _edit: &Edit) -> Option<Gesture> {
        if let Some(place) = self.fly.take() {
            let result = hand.snapshot.result.as_ref()?;
            let diagonal = result.view.mesh()?.bounds().diagonal();
            hand.canvas.fly_to(place, FLIGHT * diagonal);
        }
        if !self.shows_errors
            || hand.snapshot.is_stale
            || self.asked.as_ref() == Some(&hand.snapshot.key)
        {
            return None;
        }
        let of = hand.snapshot.result.as_ref()?.view.mesh()?.clone();
        let input = hand.input?.clone();
        self.asked = Some(hand.snapshot.key.clone());
        hand.assistant.ask(ERRORS, move |memory, progress| {
            let file = input.content.mesh()?;
            let tree = memory
                .keep(ERRORS, &input.key, || Ok::<_, ()>(Bvh::new(&file.mesh)))
                .ok()?;
            let values = vertex_distances(&of.mesh, tree, progress).ok()?;
            let colored = ShownMesh::clone(&of).with_values(VertexValues {
                title: "Distance to the input".to_owned(),
                values,
                map: ColorMap::Sequential,
                range: None,
            });
            Some(Colored {
                of,
                colored: Arc::new(colored),
            })
        });
        None
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        let report = desk.snapshot.reports.get(&edit.id);
        if let Some(report) = report {
            let warning = ui.visuals().warn_fg_color;
            match report.passed {
                Some(true) => {
                    ui.label("The result is what was promised");
                }
                Some(false) => {
                    ui.colored_label(warning, "The result is not what was promised");
                }
                None => {}
            }
            for text in &report.warnings {
                ui.colored_label(warning, text);
            }
        }
        if ui
            .checkbox(&mut self.shows_errors, "Show error colors")
            .changed()
        {
            self.asked = None;
        }
        self.defects_ui(ui, desk);
        if let Some(report) = report {
            egui::CollapsingHeader::new("Figures").show(ui, |ui| {
                for (name, value) in &report.figures {
                    ui.label(format!("{}: {value}", name.replace('_', " ")));
                }
            });
        }
        None
    }
}

/// The offset before it is proved and simplified. Its time depends on the distance alone.
pub(crate) fn draft_of_offset(
    job: &DraftJob,
    memory: &mut Memory,
    progress: &Progress,
) -> Option<DraftView> {
    let (from, to) = (result_name(0), result_name(1));
    let Step::Offset(offset) = job.edit.step(&from, &to).ok()? else {
        return None;
    };
    let file = job.input.content.mesh()?;
    let view = if Drafts::cover(&offset.params) {
        let drafts = memory.keep(DRAFTS, &job.input.key, || Drafts::new(file, progress));
        let draft = drafts.ok()?.draft(&offset.params, progress)?;
        View::Mesh(Arc::new(ShownMesh::new(Arc::new(draft))))
    } else {
        coarse_offset(job, offset.params.distance, progress)?
    };
    Some(DraftView::whole(view))
}

/// The offset with a fifth of the distance as its tolerance, not simplified: for shells and sheets, which have no drafts.
fn coarse_offset(job: &DraftJob, distance: Length, progress: &Progress) -> Option<View> {
    let edit = job
        .edit
        .with_param("tolerance", distance.abs().times(0.2).to_string().into())
        .with_param("no_simplify", true.into());
    let (output, _) = run_in_memory(&edit, &job.input.content, progress).ok()?;
    Some(View::new(&output, 0.0))
}
