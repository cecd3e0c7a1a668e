//! Planes under the hand: proposals from the edges of the picture, and grids that snap to edges.

use super::quad::{self, Corners};
use super::{Desk, Hand};
use crate::assistant::Memory;
use crate::engine::EditInput;
use egui::{Color32, Key, Ui};
use ravec::planar::{QuadGrid, SnapParams, encoded_luminance, propose_planes, snap, snap_counting};
use ravec::progress::Progress;
use ravec::raster::{Image, PremulLinearRgba, Pyramid, Reduction, with_image};
use ravec::twocolor::line_segments;
use ravec_media::focal_px_from_35mm;
use std::sync::Arc;

/// Columns and rows that are searched for at most: finer grids find edges everywhere.
const MAX_COUNT: u32 = 12;

/// Color of proposals.
const PROPOSAL: Color32 = Color32::from_rgb(80, 190, 255);

/// Help for setting planes by hand.
#[derive(Default)]
pub(crate) struct PlaneAids {
    /// True while proposals light up below the cursor.
    pub proposes: bool,
    /// Columns and rows of the grid that snaps; zeros search for them.
    pub grid: [u32; 2],
    /// The input whose edges were asked for.
    prepared: Option<Arc<str>>,
    /// The quadrilateral for which snapping was asked.
    snapping: Option<Corners>,
    /// The last message.
    message: String,
}

/// Proposals for a picture.
struct Proposed {
    key: Arc<str>,
    quads: Vec<Corners>,
}

/// Result of snapping.
struct SnapAnswer {
    from: Corners,
    found: Result<(Corners, [u32; 2]), String>,
}

impl PlaneAids {
    /// The controls.
    pub fn ui(&mut self, ui: &mut Ui, _desk: &Desk<'_>) {
        ui.checkbox(&mut self.proposes, "Propose planes")
            .on_hover_text("Planes of the picture light up below the cursor; a click takes one");
        ui.horizontal(|ui| {
            for (k, name) in [(0, "Columns"), (1, "Rows")] {
                let label = ui.label(name);
                let value = egui::DragValue::new(&mut self.grid[k]).range(0..=100);
                let shown = value.custom_formatter(|value, _| {
                    if value == 0.0 {
                        "any".to_owned()
                    } else {
                        value.to_string()
                    }
                });
                ui.add(shown).labelled_by(label.id);
            }
        });
        ui.weak("S snaps the grid to edges; Shift+wheel columns, Alt+wheel rows");
        if !self.message.is_empty() {
            ui.label(&self.message);
        }
    }

    /// Columns and rows of the grid as they are drawn.
    pub fn drawn_grid(&self) -> [u32; 2] {
        self.grid.map(|count| if count == 0 { 6 } else { count })
    }

    /// The proposal that the hand takes in this frame.
    pub fn follow_proposals(&self, hand: &Hand<'_>, taken: &[Corners]) -> Option<Corners> {
        if !self.proposes || hand.pans() {
            return None;
        }
        let proposed = hand.assistant.answer::<Proposed>("planes");
        let Some(proposed) = proposed.filter(|proposed| proposed.key == hand.input.key) else {
            if !hand.assistant.is_asked("planes") {
                let input = hand.input.clone();
                hand.assistant
                    .ask("planes", move |_, progress| propose(&input, progress));
            }
            return None;
        };
        let at = hand.response.hover_pos()?;
        if taken.iter().any(|corners| {
            quad::grip(hand.view, corners, at).is_some_and(|grip| grip != quad::Grip::Inside)
        }) {
            return None;
        }
        let below = proposed.quads.iter().find(|corners| {
            let places = corners.map(|[x, y]| hand.view.to_screen(x, y));
            quad::contains(&places, at)
        })?;
        quad::paint(hand.painter, hand.view, below, [4, 4], PROPOSAL, false);
        hand.clicked().map(|_| *below)
    }

    /// Changes the columns and rows by the wheel, and snaps a quadrilateral by its key; the corners that were found in this frame.
    pub fn follow_snap(&mut self, hand: &Hand<'_>, corners: &Corners) -> Option<Corners> {
        let turned = hand.wheel();
        if turned != 0.0 {
            let k = usize::from(hand.ui.input(|input| input.modifiers.alt));
            self.grid[k] = self.grid[k].saturating_add_signed(turned as i32).min(100);
        }
        if self.prepared.as_ref() != Some(&hand.input.key) {
            self.prepared = Some(hand.input.key.clone());
            let input = hand.input.clone();
            // the first snap need not wait for it
            hand.assistant.ask("luminance", move |memory, _| {
                luminance(memory, &input).map(drop)
            });
        }
        let pressed = hand
            .ui
            .input(|input| input.key_pressed(Key::S) && input.modifiers.is_none());
        if pressed && !hand.ui.ctx().egui_wants_keyboard_input() {
            let (input, from, grid) = (hand.input.clone(), *corners, self.grid);
            self.snapping = Some(from);
            hand.assistant.ask("snap", move |memory, progress| {
                let picture = luminance(memory, &input)?;
                let found = snapped(picture, &from, grid, progress);
                Some(SnapAnswer { from, found })
            });
        }
        let answer = hand.assistant.answer::<SnapAnswer>("snap")?;
        if self.snapping != Some(answer.from) || answer.from != *corners {
            return None;
        }
        self.snapping = None;
        match &answer.found {
            Ok((corners, grid)) => {
                self.grid = *grid;
                self.message = format!("Snapped to {} x {} cells", grid[0], grid[1]);
                Some(*corners)
            }
            Err(reason) => {
                self.message.clone_from(reason);
                None
            }
        }
    }
}

/// The luminance of a picture and its reductions, in which edges are found.
fn luminance<'a>(memory: &'a mut Memory, input: &EditInput) -> Option<&'a mut Pyramid<f32>> {
    let picture = input.content.picture()?;
    let make = || {
        let plane = with_image!(&picture.image, image => encoded_luminance(image));
        Ok::<_, ()>(Pyramid::new(plane, Reduction::Area))
    };
    memory.keep("luminance", &input.key, make).ok()
}

/// The planes that the edges of a picture propose.
fn propose(input: &EditInput, progress: &Progress) -> Option<Proposed> {
    let picture = input.content.picture()?;
    let [width, height] = input.content.size();
    let film = picture.origin.focal_35mm();
    let focal = film.map(|film| focal_px_from_35mm(film, width, height));
    let image: Image<PremulLinearRgba> = picture.convert();
    let edges = line_segments(&image, progress).ok()?;
    let extent = glam::dvec2(width as f64, height as f64);
    let found = propose_planes(&edges, extent, focal, progress).ok()?;
    let quads = found
        .planes
        .iter()
        .map(|plane| plane.quad.map(|at| at.to_array()));
    Some(Proposed {
        key: input.key.clone(),
        quads: quads.collect(),
    })
}

/// Corners on edges, with the columns and rows of the grid.
fn snapped(
    picture: &Pyramid<f32>,
    corners: &Corners,
    [columns, rows]: [u32; 2],
    progress: &Progress,
) -> Result<(Corners, [u32; 2]), String> {
    let params = SnapParams::default();
    let corners = corners.map(Into::into);
    let rough =
        QuadGrid::new(corners, columns.max(1), rows.max(1)).map_err(|error| error.to_string())?;
    let found = if columns > 0 && rows > 0 {
        snap(picture, &rough, &params, progress)
    } else {
        let range = |count: u32| {
            if count > 0 {
                count..=count
            } else {
                1..=MAX_COUNT
            }
        };
        snap_counting(
            picture,
            &rough,
            range(columns),
            range(rows),
            &params,
            progress,
        )
    };
    let grid = found.map_err(|error| error.to_string())?.grid;
    let corners = grid.corners().map(|at| at.to_array());
    Ok((corners, [grid.columns(), grid.rows()]))
}
