//! Options of the canvas, and their controls.

use egui::{Slider, Ui};
use glam::DVec3;
use ravec::mesh::Aabb;
use ravec::mesh_render::{Section, UpAxis, View};

/// A section across an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SectionOptions {
    /// `true` if the mesh is cut.
    pub on: bool,
    /// The axis across which it is cut: 0, 1 or 2 (default 1, which opens the front).
    pub axis: usize,
    /// The coordinate at which it is cut; the middle of the mesh if not given.
    pub position: Option<f64>,
    /// `true` if what is at larger coordinates stays (default true).
    pub flip: bool,
    /// `true` if the inside is filled (default true).
    pub caps: bool,
}

impl Default for SectionOptions {
    fn default() -> Self {
        Self {
            on: false,
            axis: 1,
            position: None,
            flip: true,
            caps: true,
        }
    }
}

/// Display options of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of its own")]
pub struct MeshOptions {
    /// `true` in perspective, `false` if parallels stay parallel (default true).
    pub perspective: bool,
    /// The axis that points upward (default z).
    pub up: UpAxis,
    /// `true` if light shows the shape (default true); else a drawing of lines.
    pub shaded: bool,
    /// `true` if triangles of a smooth surface look smooth (default true).
    pub smooth: bool,
    /// `true` if the edges of all triangles are drawn (default false).
    pub all_edges: bool,
    /// `true` if creases, borders and outlines are drawn (default true).
    pub feature_edges: bool,
    /// Edges are features where normals differ by more, in degrees from 0 to 180 (default 30).
    pub feature_angle_deg: f64,
    /// `true` if values are shown as colors (default true).
    pub colors: bool,
    /// `true` if marked places are shown (default true).
    pub marks: bool,
    /// `true` if the ghost is shown (default true).
    pub ghost: bool,
    /// The section.
    pub section: SectionOptions,
    /// `true` if clicks measure (default false).
    pub measure: bool,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self {
            perspective: true,
            up: UpAxis::Z,
            shaded: true,
            smooth: true,
            all_edges: false,
            feature_edges: true,
            feature_angle_deg: 30.0,
            colors: true,
            marks: true,
            ghost: true,
            section: SectionOptions::default(),
            measure: false,
        }
    }
}

impl MeshOptions {
    /// The section of a mesh in a box, if there is one.
    pub fn section(&self, bounds: Aabb) -> Option<Section> {
        let SectionOptions {
            on,
            axis,
            flip,
            caps,
            ..
        } = self.section;
        if !on || bounds.is_empty() {
            return None;
        }
        let position = self.section_position(bounds);
        let sign = if flip { -1.0 } else { 1.0 };
        Some(Section {
            normal: sign * DVec3::AXES[axis.min(2)],
            offset: sign * position,
            capped: caps,
        })
    }

    fn section_position(&self, bounds: Aabb) -> f64 {
        let axis = self.section.axis.min(2);
        let middle = bounds.center()[axis];
        self.section.position.unwrap_or(middle)
    }
}

/// A request of the controls to the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Command {
    View(View),
    Fit,
}

/// The named views, as buttons.
const VIEWS: [(&str, View); 7] = [
    ("Front", View::FRONT),
    ("Right", View::RIGHT),
    ("Back", View::BACK),
    ("Left", View::LEFT),
    ("Top", View::TOP),
    ("Bottom", View::BOTTOM),
    ("Iso", View::ISO),
];

/// Draws the controls.
pub(super) fn options_ui(ui: &mut Ui, options: &mut MeshOptions, bounds: Aabb) -> Option<Command> {
    let mut command = None;
    ui.horizontal_wrapped(|ui| {
        for (name, view) in VIEWS {
            if ui.button(name).clicked() {
                command = Some(Command::View(view));
            }
        }
        let fit = ui.button("Fit").on_hover_text("Show all of the mesh (F)");
        if fit.clicked() {
            command = Some(Command::Fit);
        }
    });
    ui.horizontal_wrapped(|ui| {
        ui.selectable_value(&mut options.perspective, true, "Perspective")
            .on_hover_text("What is far looks smaller");
        ui.selectable_value(&mut options.perspective, false, "Parallel")
            .on_hover_text("Parallel lines stay parallel, and lengths can be compared");
        let mut y_up = options.up == UpAxis::Y;
        ui.checkbox(&mut y_up, "Y is up")
            .on_hover_text("The axis y points upward, as in most scans and games; else z");
        options.up = if y_up { UpAxis::Y } else { UpAxis::Z };
    });
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(&mut options.shaded, "Shaded")
            .on_hover_text("Light shows the shape; else only lines do");
        ui.add_enabled(
            options.shaded,
            egui::Checkbox::new(&mut options.smooth, "Smooth"),
        )
        .on_hover_text("Light changes smoothly over triangles that bend little");
        ui.checkbox(&mut options.all_edges, "All edges")
            .on_hover_text("The edges of all triangles");
    });
    ui.checkbox(&mut options.feature_edges, "Feature edges")
        .on_hover_text("Creases, borders and outlines");
    if options.feature_edges {
        let angle = Slider::new(&mut options.feature_angle_deg, 0.0..=180.0)
            .max_decimals(0)
            .suffix(" deg")
            .text("Feature angle");
        ui.add(angle)
            .on_hover_text("Edges are creases where triangles bend by more. Less draws more edges");
    }
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(&mut options.colors, "Colors")
            .on_hover_text("Values at vertices, such as distances, as colors");
        ui.checkbox(&mut options.marks, "Defects")
            .on_hover_text("Marked places, in red");
        ui.checkbox(&mut options.ghost, "Ghost")
            .on_hover_text("The input, translucent");
    });
    section_ui(ui, options, bounds);
    ui.checkbox(&mut options.measure, "Measure")
        .on_hover_text("Two clicks measure a distance; near a corner they take the corner");
    command
}

fn section_ui(ui: &mut Ui, options: &mut MeshOptions, bounds: Aabb) {
    ui.checkbox(&mut options.section.on, "Section")
        .on_hover_text("Cut a part away");
    if !options.section.on {
        return;
    }
    ui.horizontal_wrapped(|ui| {
        for (axis, name) in ["Across X", "Across Y", "Across Z"].into_iter().enumerate() {
            let chosen = options.section.axis == axis;
            if ui.selectable_label(chosen, name).clicked() && !chosen {
                options.section.axis = axis;
                options.section.position = None;
            }
        }
    });
    if !bounds.is_empty() {
        let axis = options.section.axis.min(2);
        let mut position = options.section_position(bounds);
        let range = bounds.min[axis]..=bounds.max[axis];
        let slider = Slider::new(&mut position, range)
            .clamping(egui::SliderClamping::Never)
            .text("Section position");
        let response = ui.add(slider);
        if response.changed() && position.is_finite() {
            options.section.position = Some(position);
        }
        response.on_hover_text("The coordinate of the cut, in units of the file");
    }
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(&mut options.section.caps, "Caps")
            .on_hover_text("Fill the inside of solids");
        ui.checkbox(&mut options.section.flip, "Flip")
            .on_hover_text("Take the other side away");
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_is_in_the_middle_until_it_is_moved_and_flips_in_place() {
        let bounds = Aabb::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(2.0, 6.0, 9.0));
        let mut options = MeshOptions::default();
        assert_eq!(options.section(bounds), None);
        options.section.on = true;
        assert_eq!(options.section(Aabb::EMPTY), None);
        for (axis, middle) in [(0, 1.5), (1, 4.0), (2, 6.0)] {
            options.section.axis = axis;
            options.section.position = None;
            for flip in [false, true] {
                options.section.flip = flip;
                let section = options.section(bounds).unwrap();
                let place = middle * DVec3::AXES[axis];
                assert_eq!(section.normal.dot(place), section.offset);
                let taken = section.normal.dot(bounds.max) > section.offset;
                assert_eq!(taken, !flip);
            }
            options.section.position = Some(0.25);
            assert_eq!(options.section(bounds).unwrap().offset, -0.25);
        }
    }
}
