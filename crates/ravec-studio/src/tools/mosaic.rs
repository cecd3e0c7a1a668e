//! Photo mosaics: a catalogue is chosen or made, and tiles are clicked to pin or ban photos.

mod by_hand;
mod task;

use super::{Desk, DraftFn, DraftJob, DraftView, Gesture, Hand, Tool, with_params};
use crate::assistant::{Assistant, Memory};
use crate::content::View;
use crate::document::{Edit, EditId};
use crate::engine::{EditInput, Snapshot};
use crate::shown::Shown;
use egui::{Color32, ColorImage, Stroke, StrokeKind, TextureHandle, TextureOptions, Ui};
use ravec::progress::Progress;
use ravec::raster::{Image, Rect, Srgb};
use ravec_jobs::mosaic::{Mosaic as Operation, MosaicDesk, TileCandidate};
use ravec_jobs::{Context, Operation as _, Report, Step, catalogue};
use serde_json::{Map, Value, json};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use task::{Outcome, Task};

/// Photos that are listed for a tile.
const CANDIDATES: usize = 12;

/// A small picture of a photo.
type Small = Image<Srgb<u8>>;

/// Height of small pictures in the panel, in points.
const SMALL: f32 = 36.0;

/// Color of the selected tile.
const SELECTED: Color32 = Color32::from_rgb(250, 170, 40);
/// Color of pinned tiles.
const PINNED: Color32 = Color32::from_rgb(90, 220, 120);

/// Kind of the questions about candidates.
const KIND: &str = "mosaic candidates";

/// Chooses a catalogue, and pins and bans photos.
#[derive(Default)]
pub(crate) struct Mosaic {
    /// The tile that was clicked, and the edit that it is of.
    selected: Option<(EditId, [usize; 4])>,
    /// The tiles of the last result.
    tiles: Option<(Arc<Report>, Arc<Tiles>)>,
    /// The question that was asked last.
    asked: Option<Question>,
    /// Small pictures of the candidates that are shown.
    textures: Option<(Arc<Found>, HashMap<PathBuf, TextureHandle>)>,
    /// The folder of photos that is typed.
    folder: String,
    /// The file of the new catalogue that is typed; empty for one beside the folder.
    file: String,
    /// The folder of the page that is typed.
    page: String,
    task: Option<Task>,
    /// The end of the last task in words, and true if it failed.
    message: Option<(String, bool)>,
}

/// The tiles of a result.
#[derive(Debug, Default)]
struct Tiles {
    /// Left, top, columns and rows of each in the mosaic.
    places: Vec<[usize; 4]>,
    photos: Vec<PathBuf>,
    /// Columns of the grid.
    columns: usize,
}

impl Tiles {
    fn of(report: &Report) -> Self {
        let result = report.result.as_ref();
        let list = |name: &str| result.map_or(Value::Null, |result| result[name].clone());
        Self {
            places: serde_json::from_value(list("places")).unwrap_or_default(),
            photos: serde_json::from_value(list("photos")).unwrap_or_default(),
            columns: report
                .figures
                .get("columns")
                .map_or(1, |&count| count as usize),
        }
    }

    fn at(&self, [x, y]: [f64; 2]) -> Option<[usize; 4]> {
        let within = |at: f64, start: usize, length: usize| {
            at >= start as f64 && at < (start + length) as f64
        };
        let mut places = self.places.iter();
        places
            .find(|[left, top, width, height]| within(x, *left, *width) && within(y, *top, *height))
            .copied()
    }

    fn number(&self, place: [usize; 4]) -> Option<usize> {
        self.places.iter().position(|&other| other == place)
    }

    /// Column and row in the grid.
    fn in_grid(&self, number: usize) -> [usize; 2] {
        let columns = self.columns.max(1);
        [number % columns, number / columns]
    }
}

/// A question about a tile.
#[derive(Debug, Clone, PartialEq)]
struct Question {
    key: Arc<str>,
    fields: Map<String, Value>,
    place: [usize; 4],
}

/// The photos that fit a tile, the nearest first.
struct Found {
    question: Question,
    candidates: Result<Vec<TileCandidate>, String>,
    /// The photo that the tile has.
    current: Option<(PathBuf, Small)>,
}

impl Tool for Mosaic {
    fn operation(&self) -> &'static str {
        "mosaic"
    }

    fn label(&self) -> &'static str {
        "Mosaic"
    }

    fn hint(&self) -> &'static str {
        "Click a tile to see the photos that fit it"
    }

    /// Tiles of the proportions that photos often have, of which many fit with little loss.
    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        with_params(json!({"tiles": "40", "tile_size": "64x48", "crop": "center"}))
    }

    fn works_on_input(&self, edit: &Edit) -> bool {
        // without a catalogue there is nothing to run
        !edit.fields.contains_key("catalogue")
    }

    fn draft(&self) -> Option<DraftFn> {
        Some(draft)
    }

    fn drafts_first(&self) -> bool {
        true
    }

    fn hidden(&self) -> &'static [&'static str] {
        &[
            "catalogue",
            "deep_zoom",
            "preview",
            "pins",
            "bans",
            "tiles",
            "max_uses",
        ]
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let tiles = self.tiles_of(hand.snapshot, edit)?;
        if !is_adaptive(edit) {
            for pin in by_hand::pins(edit) {
                let [col, row] = pin.tile;
                let number = row * tiles.columns + col;
                if let Some(&place) = tiles.places.get(number).filter(|_| col < tiles.columns) {
                    paint(hand, place, PINNED);
                }
            }
        }
        let clicked = hand.clicked().filter(|_| !hand.snapshot.is_stale);
        if let Some(at) = clicked {
            self.selected = tiles.at(at).map(|place| (edit.id, place));
        }
        let (of, place) = self.selected?;
        let number = tiles.number(place).filter(|_| of == edit.id)?;
        paint(hand, place, SELECTED);
        if !hand.snapshot.is_stale {
            self.ask(
                hand.assistant,
                hand.input,
                edit,
                place,
                &tiles.photos[number],
            );
        }
        None
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        let mut gesture = self.take_ended(desk.assistant, edit);
        let mut take = |found: Option<Gesture>| gesture = gesture.take().or(found);
        take(self.catalogue_ui(ui, desk, edit).map(Gesture::done));
        if !edit.fields.contains_key("catalogue") {
            return gesture;
        }
        take(counts_ui(ui, edit));
        ui.separator();
        take(self.tile_ui(ui, desk, edit).map(Gesture::done));
        take(by_hand_ui(ui, edit).map(Gesture::done));
        take(self.page_ui(ui, desk, edit).map(Gesture::done));
        gesture
    }
}

fn is_adaptive(edit: &Edit) -> bool {
    edit.param("adaptive") == true
}

/// The name of a photo without its folder.
fn name(photo: &Path) -> String {
    let name = photo.file_name().unwrap_or(photo.as_os_str());
    name.to_string_lossy().into_owned()
}

/// The path that is typed, from the root.
fn typed(text: &str) -> PathBuf {
    let path = Path::new(text.trim());
    std::path::absolute(path).unwrap_or_else(|_| path.into())
}

fn paint(hand: &Hand<'_>, [left, top, width, height]: [usize; 4], color: Color32) {
    let at = |x: usize, y: usize| hand.view.to_screen(x as f64, y as f64);
    let frame = egui::Rect::from_min_max(at(left, top), at(left + width, top + height));
    let stroke = Stroke::new(2.0, color);
    hand.painter
        .rect_stroke(frame, 0.0, stroke, StrokeKind::Inside);
}

/// A button with a name of its own, since many have the same text.
fn named_button(ui: &mut Ui, text: &str, name: &str, help: &str) -> bool {
    let button = ui.small_button(text).on_hover_text(help);
    button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, name));
    button.clicked()
}

fn path_ui(ui: &mut Ui, label: &str, text: &mut String, hint: &str) {
    ui.horizontal(|ui| {
        let label = ui.label(label);
        let field = egui::TextEdit::singleline(text).hint_text(hint);
        ui.add(field.desired_width(180.0)).labelled_by(label.id);
    });
}

impl Mosaic {
    /// The tiles of the last good result of an edit.
    fn tiles_of(&mut self, snapshot: &Snapshot, edit: &Edit) -> Option<Arc<Tiles>> {
        let report = snapshot.reports.get(&edit.id)?;
        if let Some((of, tiles)) = &self.tiles
            && Arc::ptr_eq(of, report)
        {
            return Some(tiles.clone());
        }
        let tiles = Arc::new(Tiles::of(report));
        self.tiles = Some((report.clone(), tiles.clone()));
        Some(tiles)
    }

    /// Asks for the photos that fit a tile, unless that was done.
    fn ask(
        &mut self,
        assistant: &Assistant,
        input: &EditInput,
        edit: &Edit,
        place: [usize; 4],
        photo: &Path,
    ) {
        let question = Question {
            key: input.key.clone(),
            fields: edit.fields.clone(),
            place,
        };
        if self.asked.as_ref() == Some(&question) {
            return;
        }
        self.asked = Some(question.clone());
        let (input, edit, photo) = (input.clone(), edit.clone(), photo.to_path_buf());
        assistant.ask(KIND, move |memory, progress| {
            let found = find(&input, &edit, place, &photo, memory, progress);
            let (candidates, current) = match found {
                Ok((candidates, small)) => (Ok(candidates), small),
                Err(reason) => (Err(reason), None),
            };
            Some(Found {
                question,
                candidates,
                current: current.map(|small| (photo, small)),
            })
        });
    }

    /// Takes the end of a task: a catalogue that was made becomes that of the edit.
    fn take_ended(&mut self, assistant: &Assistant, edit: &Edit) -> Option<Gesture> {
        let ended = self.task.as_ref()?.ended(assistant)?;
        self.task = None;
        match &ended.outcome {
            Err(reason) => {
                self.message = Some((reason.clone(), true));
                None
            }
            Ok((path, text)) => {
                self.message = Some((text.clone(), false));
                let is_new = ended.is_catalogue && ended.edit == edit.id;
                is_new.then(|| Gesture::done(with_catalogue(edit, path)))
            }
        }
    }

    fn catalogue_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Edit> {
        let mut changed = None;
        let known = edit.fields.get("catalogue").and_then(Value::as_str);
        ui.horizontal(|ui| {
            let label = ui.label("Catalogue");
            let id = ui.scope_id().with(("catalogue", edit.id));
            let kept = ui.data(|data| data.get_temp::<String>(id));
            let mut text = kept.unwrap_or_else(|| known.unwrap_or_default().to_owned());
            let field = egui::TextEdit::singleline(&mut text).desired_width(180.0);
            let field = ui.add(field).labelled_by(label.id);
            let entered =
                field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
            if ui.button("Use").clicked() || entered {
                ui.data_mut(|data| data.remove::<String>(id));
                if !text.trim().is_empty() {
                    changed = Some(with_catalogue(edit, &typed(&text)));
                }
            } else if field.changed() {
                ui.data_mut(|data| data.insert_temp(id, text));
            }
        });
        egui::CollapsingHeader::new("New catalogue")
            .default_open(known.is_none())
            .show(ui, |ui| {
                path_ui(ui, "Folder of photos", &mut self.folder, "");
                path_ui(ui, "File", &mut self.file, "beside the folder");
                let ready = self.task.is_none() && !self.folder.trim().is_empty();
                let button = egui::Button::new("Make the catalogue");
                let button = ui.add_enabled(ready, button).on_hover_text(
                    "Photos are only read; what an older catalogue of that name has is not read again",
                );
                if button.clicked() {
                    let folder = typed(&self.folder);
                    let file = if self.file.trim().is_empty() {
                        beside(&folder)
                    } else {
                        typed(&self.file)
                    };
                    self.message = None;
                    let job = move |progress: &Progress| make_catalogue(folder, file, progress);
                    self.task = Some(Task::start(ui, desk.assistant, edit.id, true, job));
                }
            });
        if let Some(task) = &self.task {
            task.ui(ui);
        }
        if let Some((text, wrong)) = &self.message {
            if *wrong {
                ui.colored_label(ui.visuals().error_fg_color, text);
            } else {
                ui.label(text);
            }
        }
        changed
    }

    /// The selected tile and the photos that fit it.
    fn tile_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Edit> {
        let tiles = self.tiles_of(desk.snapshot, edit);
        let selected = self.selected.filter(|(of, _)| *of == edit.id);
        let number = selected
            .zip(tiles.as_ref())
            .and_then(|((_, place), tiles)| Some((place, tiles.number(place)?)));
        let (Some((place, number)), Some(tiles)) = (number, tiles) else {
            ui.weak("Click a tile to see the photos that fit it.");
            return None;
        };
        let tile = (!is_adaptive(edit)).then(|| tiles.in_grid(number));
        match tile {
            Some([col, row]) => ui.label(format!("Tile {col},{row}")),
            None => ui.label("Tile off the grid: photos can be banned, not pinned"),
        };
        let found = desk.assistant.answer::<Found>(KIND)?;
        if found.question.place != place {
            return None;
        }
        let mut changed = None;
        if let Some((photo, small)) = &found.current
            && *photo == tiles.photos[number]
        {
            ui.horizontal(|ui| {
                self.small_ui(ui, &found, photo, small);
                ui.label(format!("has {}", name(photo)))
                    .on_hover_text(photo.display().to_string());
            });
            ui.horizontal(|ui| {
                changed = decide_ui(ui, edit, tile, photo, "its photo");
            });
        }
        let candidates = match &found.candidates {
            Ok(candidates) => candidates,
            Err(reason) => {
                ui.colored_label(ui.visuals().error_fg_color, reason);
                return changed;
            }
        };
        for candidate in candidates {
            let photo = &candidate.photo;
            ui.horizontal(|ui| {
                self.small_ui(ui, &found, photo, &candidate.small);
                let decided = decide_ui(ui, edit, tile, photo, &name(photo));
                changed = changed.take().or(decided);
                let text = format!("{:.3} {}", candidate.distance, name(photo));
                ui.label(text).on_hover_text(format!(
                    "{}; the distance is 0 for the same colors everywhere",
                    photo.display()
                ));
            });
        }
        changed
    }

    /// Draws the small picture of a photo.
    fn small_ui(&mut self, ui: &mut Ui, found: &Arc<Found>, photo: &Path, small: &Small) {
        let current = self.textures.take();
        let current = current.filter(|(of, _)| Arc::ptr_eq(of, found));
        let (_, textures) = self
            .textures
            .insert(current.unwrap_or_else(|| (found.clone(), HashMap::new())));
        let texture = textures.entry(photo.to_path_buf()).or_insert_with(|| {
            let bytes: Vec<u8> = small.pixels().iter().flat_map(|pixel| pixel.0).collect();
            let image = ColorImage::from_rgb([small.width(), small.height()], &bytes);
            let name = photo.to_string_lossy();
            ui.ctx().load_texture(name, image, TextureOptions::LINEAR)
        });
        let size = egui::vec2(SMALL, SMALL);
        ui.add(
            egui::Image::new(&*texture)
                .fit_to_exact_size(size)
                .maintain_aspect_ratio(true),
        );
    }

    /// A page that zooms into the photos.
    fn page_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Edit> {
        let mut changed = None;
        egui::CollapsingHeader::new("Page that zooms into the photos").show(ui, |ui| {
            let known = edit.fields.get("deep_zoom").and_then(Value::as_str);
            path_ui(
                ui,
                "Folder of the page",
                &mut self.page,
                known.unwrap_or(""),
            );
            let some = !self.page.trim().is_empty();
            let input = desk.input.cloned();
            let ready = self.task.is_none() && some && input.is_some();
            let write = egui::Button::new("Write the page");
            if ui
                .add_enabled(ready, write)
                .on_hover_text("The folder may be new, empty, or an older page, which is replaced")
                .clicked()
                && let Some(input) = input
            {
                let (edit, folder) = (edit.clone(), typed(&self.page));
                self.message = None;
                let number = edit.id;
                let job = move |progress: &Progress| write_page(&edit, &input, &folder, progress);
                self.task = Some(Task::start(ui, desk.assistant, number, false, job));
            }
            let mut with_exports = known.is_some();
            let label = "Write it with every export";
            let allowed = some || with_exports;
            let switch = egui::Checkbox::new(&mut with_exports, label);
            if ui
                .add_enabled(allowed, switch)
                .on_hover_text("Also when the saved project is run")
                .changed()
            {
                let mut edit = edit.clone();
                if with_exports {
                    let folder = typed(&self.page).display().to_string();
                    edit.fields.insert("deep_zoom".to_owned(), folder.into());
                } else {
                    edit.fields.remove("deep_zoom");
                }
                changed = Some(edit);
            }
        });
        changed
    }
}

/// The buttons about a photo for a tile, or for all tiles.
fn decide_ui(
    ui: &mut Ui,
    edit: &Edit,
    tile: Option<[usize; 2]>,
    photo: &Path,
    name: &str,
) -> Option<Edit> {
    let mut changed = None;
    if let Some(tile) = tile {
        let help = "The tile has this photo, whatever the limits on repeats say";
        if named_button(ui, "Pin", &format!("Pin {name}"), help) {
            changed = Some(by_hand::with_pin(edit, tile, photo));
        }
        let help = "Neither this photo nor a near-duplicate is at this tile";
        if named_button(ui, "Not here", &format!("Not here: {name}"), help) {
            changed = Some(by_hand::with_ban(edit, Some(tile), photo));
        }
    }
    let help = "Neither this photo nor a near-duplicate is used";
    if named_button(ui, "Ban", &format!("Ban {name}"), help) {
        changed = Some(by_hand::with_ban(edit, None, photo));
    }
    changed
}

/// The list of pins and bans.
fn by_hand_ui(ui: &mut Ui, edit: &Edit) -> Option<Edit> {
    let (pins, bans) = (by_hand::pins(edit), by_hand::bans(edit));
    if pins.is_empty() && bans.is_empty() {
        return None;
    }
    let mut changed = None;
    ui.separator();
    for pin in pins {
        let [col, row] = pin.tile;
        ui.horizontal(|ui| {
            if named_button(ui, "Remove", &format!("Unpin {col},{row}"), "") {
                changed = Some(by_hand::without_pin(edit, pin.tile));
            }
            ui.label(format!("{} is pinned to {col},{row}", name(&pin.photo)));
        });
    }
    for ban in bans {
        let photo = name(&ban.photo);
        let place = ban.tile.map(|[col, row]| format!(" at {col},{row}"));
        let place = place.unwrap_or_default();
        ui.horizontal(|ui| {
            if named_button(ui, "Remove", &format!("Allow {photo}{place}"), "") {
                changed = Some(by_hand::without_ban(edit, &ban));
            }
            ui.label(format!("{photo} is banned{place}"));
        });
    }
    changed
}

/// Columns of tiles, and the limit on uses.
fn counts_ui(ui: &mut Ui, edit: &Edit) -> Option<Gesture> {
    let mut changed = None;
    ui.horizontal(|ui| {
        let label = ui.label("Columns").on_hover_text(
            "Tiles in a row; rows follow from the picture. More show more of the picture and less of each photo",
        );
        let text = edit.param("tiles").as_str().unwrap_or("60");
        let across = text.split_once('x').map_or(text, |(across, _)| across);
        let mut columns: u32 = across.parse().unwrap_or(60);
        let slider = egui::Slider::new(&mut columns, 2..=400).logarithmic(true);
        let response = ui.add(slider).labelled_by(label.id);
        if response.changed() {
            changed = Some(Gesture {
                edit: edit.with_param("tiles", columns.to_string().into()),
                goes_on: response.dragged(),
            });
        }
    });
    ui.horizontal(|ui| {
        let uses = edit.param("max_uses").as_u64();
        let mut limited = uses.is_some();
        if ui.checkbox(&mut limited, "Limit uses of a photo").changed() {
            let value = if limited { 4.into() } else { Value::Null };
            changed = Some(Gesture::done(edit.with_param("max_uses", value)));
        }
        if let Some(mut uses) = uses {
            let value = egui::DragValue::new(&mut uses).range(1..=10_000);
            let response = ui.add(value.speed(0.1));
            if response.changed() {
                changed = Some(Gesture {
                    edit: edit.with_param("max_uses", uses.into()),
                    goes_on: response.dragged(),
                });
            }
        }
    });
    changed
}

fn with_catalogue(edit: &Edit, path: &Path) -> Edit {
    let mut edit = edit.clone();
    let path = path.display().to_string();
    edit.fields.insert("catalogue".to_owned(), path.into());
    edit
}

/// The file of a catalogue beside its folder of photos.
fn beside(folder: &Path) -> PathBuf {
    let mut name = folder.file_name().unwrap_or("photos".as_ref()).to_owned();
    name.push(".ravec");
    folder.with_file_name(name)
}

/// Adds the photos of a folder to a catalogue, which is created if it is missing.
fn make_catalogue(folder: PathBuf, file: PathBuf, progress: &Progress) -> Outcome {
    let add = catalogue::Add {
        paths: vec![folder],
        catalogue: file.clone(),
        params: catalogue::Plain::default(),
    };
    let report = add.run(&Context::new(progress));
    let report = report.map_err(|error| error.to_string())?;
    let count = |name: &str| report.figures.get(name).copied().unwrap_or_default();
    let text = format!(
        "{}: {} new photos, {} known ones, {} that cannot be read",
        name(&file),
        count("new") + count("changed"),
        count("unchanged") + count("moved"),
        count("unreadable")
    );
    Ok((file, text))
}

/// The operation of an edit.
fn operation(edit: &Edit) -> Result<Operation, String> {
    let edit = edit.without_side_outputs();
    match edit.step("@in".as_ref(), "@out".as_ref())? {
        Step::Mosaic(operation) => Ok(*operation),
        _ => Err("this is no mosaic".to_owned()),
    }
}

/// Writes the page of an edit.
fn write_page(edit: &Edit, input: &EditInput, folder: &Path, progress: &Progress) -> Outcome {
    let operation = Operation {
        output: None,
        deep_zoom: Some(folder.to_path_buf()),
        ..operation(edit)?
    };
    let picture = input.content.picture().ok_or("mosaics are of pictures")?;
    let context = Context::new(progress).with_intermediates();
    context.insert_picture(&operation.input, (**picture).clone());
    let done = operation.run(&context);
    done.map_err(|error| error.to_string())?;
    let page = folder.join("index.html");
    let text = format!("{} is written", page.display());
    Ok((page, text))
}

/// The photos of a catalogue, kept from one question to the next.
fn photos<'a>(
    operation: &Operation,
    memory: &'a mut Memory,
    context: &Context,
) -> Result<&'a mut MosaicDesk, String> {
    let words = |error: ravec_jobs::JobError| error.to_string();
    let key = MosaicDesk::key(operation).map_err(words)?.into();
    memory
        .keep("mosaic photos", &key, || {
            MosaicDesk::open(operation, context)
        })
        .map_err(words)
}

/// The photos that fit a tile, and the small picture of the one that it has.
fn find(
    input: &EditInput,
    edit: &Edit,
    [col, row, width, height]: [usize; 4],
    photo: &Path,
    memory: &mut Memory,
    progress: &Progress,
) -> Result<(Vec<TileCandidate>, Option<Small>), String> {
    let picture = input.content.picture().ok_or("mosaics are of pictures")?;
    let operation = operation(edit)?;
    let context = Context::new(progress);
    let desk = photos(&operation, memory, &context)?;
    let place = Rect::new(col, row, width, height);
    let found = desk.candidates(&operation, picture, place, CANDIDATES, &context);
    let found = found.map_err(|error| error.to_string())?;
    Ok((found, desk.small(photo).cloned()))
}

/// The preview of a mosaic, stretched to its size.
fn draft(job: &DraftJob, memory: &mut Memory, progress: &Progress) -> Option<DraftView> {
    let picture = job.input.content.picture()?;
    let operation = operation(&job.edit).ok()?;
    let context = Context::new(progress);
    let desk = photos(&operation, memory, &context).ok()?;
    let preview = desk.preview(&operation, picture, &context).ok()?;
    let size = [preview.size.width(), preview.size.height()];
    let shown = Shown::new(Arc::new(preview.picture)).stretched(size);
    Some(DraftView::whole(View::Picture(Arc::new(shown))))
}
