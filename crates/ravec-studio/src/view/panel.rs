//! The panel of an edit: a control for each setting of its operation.

use crate::document::Edit;
use crate::settings::{Form, Kind, Setting, to_json, to_text};
use egui::{DragValue, RichText, Slider, TextEdit, Ui};
use serde_json::Value;

/// A change in a panel.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Name of the parameter.
    pub name: String,
    /// The new value; null for the default.
    pub value: Value,
    /// True while the hand is still on the control.
    pub goes_on: bool,
}

/// Draws the settings of an edit but those that are `hidden` and, unless it is of a clip, those of clips; and marks the one that was found by name; what was changed.
pub fn panel_ui(
    ui: &mut Ui,
    form: &Form,
    edit: &Edit,
    hidden: &[&str],
    is_clip: bool,
    highlighted: Option<&str>,
) -> Option<Change> {
    let mut change = None;
    let shown = form
        .settings
        .iter()
        .filter(|setting| !hidden.contains(&setting.name.as_str()))
        .filter(|setting| is_clip || !setting.is_of_clips());
    for setting in shown {
        let value = edit.param(&setting.name);
        let is_default = value.is_null();
        let label = if is_default {
            RichText::new(&setting.label)
        } else {
            RichText::new(&setting.label).strong()
        };
        let found = ui
            .horizontal(|ui| {
                let label = ui.label(label).on_hover_text(&setting.help);
                if highlighted == Some(setting.name.as_str()) {
                    let frame = egui::Stroke::new(1.5, ui.visuals().selection.bg_fill);
                    let place = label.rect.expand(2.0);
                    ui.painter()
                        .rect_stroke(place, 2.0, frame, egui::StrokeKind::Outside);
                    label.scroll_to_me(None);
                }
                let mut found = control_ui(ui, setting, value, label.id);
                if !is_default {
                    let hint = if setting.default.is_empty() {
                        "Back to the default".to_owned()
                    } else {
                        format!("Back to {}", setting.default)
                    };
                    let reset = ui.small_button("Reset").on_hover_text(hint);
                    let name = format!("Reset {}", setting.label);
                    reset
                        .widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
                    if reset.clicked() {
                        found = Some((Value::Null, false));
                    }
                }
                found
            })
            .inner;
        if let Some((value, goes_on)) = found {
            change = Some(Change {
                name: setting.name.clone(),
                value,
                goes_on,
            });
        }
    }
    change
}

/// The control of a setting; its new value, and true while the hand is on it.
fn control_ui(
    ui: &mut Ui,
    setting: &Setting,
    value: &Value,
    label: egui::Id,
) -> Option<(Value, bool)> {
    let text = if value.is_null() {
        setting.default.clone()
    } else {
        to_text(value)
    };
    match &setting.kind {
        Kind::Switch => {
            let mut on = text == "true";
            let response = ui.checkbox(&mut on, "").labelled_by(label);
            response.changed().then(|| (on.into(), false))
        }
        Kind::Choice(choices) => {
            let mut chosen = text.clone();
            egui::ComboBox::from_id_salt(&setting.name)
                .selected_text(&chosen)
                .show_ui(ui, |ui| {
                    for choice in choices {
                        ui.selectable_value(&mut chosen, choice.name.clone(), &choice.name)
                            .on_hover_text(&choice.help);
                    }
                })
                .response
                .labelled_by(label);
            (chosen != text).then(|| (chosen.into(), false))
        }
        Kind::Number { range, .. } if text.is_empty() => {
            // the operation finds a value by itself
            let button = ui.button("automatic").on_hover_text("Set a value by hand");
            let name = format!("Set {}", setting.label);
            button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
            let middle = range.map_or(0.0, |[low, high]| 0.5 * (low + high));
            let value = to_json(&setting.kind, &middle.to_string());
            button.clicked().then_some((value, false))
        }
        Kind::Number { range, whole } => {
            let mut number: f64 = text.parse().unwrap_or_default();
            let decimals = if *whole { 0 } else { 3 };
            let response = match range {
                Some([low, high]) => {
                    let slider = Slider::new(&mut number, *low..=*high).max_decimals(decimals);
                    ui.add(if *whole { slider.step_by(1.0) } else { slider })
                }
                None => ui.add(
                    DragValue::new(&mut number)
                        .max_decimals(decimals)
                        .speed(0.1),
                ),
            }
            .labelled_by(label);
            let value = to_json(&setting.kind, &number.to_string());
            response.changed().then(|| (value, response.dragged()))
        }
        Kind::Text | Kind::List => {
            let typed = text_ui(ui, &setting.name, &text, label)?;
            Some((to_json(&setting.kind, &typed), false))
        }
    }
}

/// A field with a text; the new text once the field is left, since what is being typed is no value yet. What was typed is dropped if
/// the text changes meanwhile, such as by an undo.
pub(crate) fn text_ui(ui: &mut Ui, name: &str, text: &str, label: egui::Id) -> Option<String> {
    let id = ui.scope_id().with(("text", name));
    let kept = ui.data(|data| data.get_temp::<(String, String)>(id));
    let kept = kept.filter(|(of, _)| of == text);
    let mut typed = kept.map_or_else(|| text.to_owned(), |(_, typed)| typed);
    let response = ui
        .add(TextEdit::singleline(&mut typed).desired_width(120.0))
        .labelled_by(label);
    if response.has_focus() {
        ui.data_mut(|data| data.insert_temp(id, (text.to_owned(), typed)));
        return None;
    }
    ui.data_mut(|data| data.remove::<(String, String)>(id));
    (response.lost_focus() && typed != text).then_some(typed)
}
