//! Pictures with captions, pairs of them with a divider, and solids that can be turned.

use super::{Solid, escaped};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ravec::raster::{Image, LinearRgba, Rect, Srgb, Srgba};
use ravec_media::{Format, Picture, WriteOptions, encode};

/// Something to look at, with a caption below.
#[derive(Debug)]
pub struct Figure {
    shown: Shown,
    caption: String,
    /// Measured figures, in small print.
    note: Option<String>,
}

#[derive(Debug)]
enum Shown {
    Single(Drawing),
    Pair {
        before: Drawing,
        after: Drawing,
        labels: [String; 2],
    },
    Solid(Drawing, Solid),
}

/// An encoded picture; without an address if there is nothing to be drawn.
#[derive(Debug)]
struct Drawing {
    source: String,
    /// Width and height on the page in CSS pixels, at most.
    size: [usize; 2],
    /// Shows each pixel as a square.
    enlarged: bool,
    /// Lets the ground shine through.
    clear: bool,
}

impl Figure {
    /// Shows a whole picture. Opaque ones are stored as JPEG of high quality, others without loss.
    pub fn picture(image: &Image<LinearRgba>, caption: impl Into<String>) -> Self {
        let opaque = image.is_opaque();
        let source = if opaque {
            data_uri(
                &Picture::from_image(image.convert::<Srgb<u8>>()),
                Format::Jpeg,
            )
        } else {
            data_uri(
                &Picture::from_image(image.convert::<Srgba<u8>>()),
                Format::Png,
            )
        };
        Self::single(
            Drawing {
                source,
                size: [image.width(), image.height()],
                enlarged: false,
                clear: !opaque,
            },
            caption,
        )
    }

    /// Shows a part of a picture with each pixel drawn as a square of `zoom` pixels, without loss. Parts beyond the picture
    /// are left out; nothing is drawn if there is nothing left.
    pub fn crop(
        image: &Image<LinearRgba>,
        part: Rect,
        zoom: usize,
        caption: impl Into<String>,
    ) -> Self {
        let part = part.intersection(Rect::of(image.size()));
        let cropped = part
            .size()
            .and_then(|size| image.crop(part.col, part.row, size).ok());
        let source = cropped.map_or(String::new(), |image| {
            data_uri(
                &Picture::from_image(image.convert::<Srgba<u8>>()),
                Format::Png,
            )
        });
        Self::single(
            Drawing {
                source,
                size: [part.width * zoom, part.height * zoom],
                enlarged: true,
                clear: !image.is_opaque(),
            },
            caption,
        )
    }

    /// Shows a drawing as SVG of `size` CSS pixels.
    pub fn svg(text: &str, size: [usize; 2], caption: impl Into<String>) -> Self {
        Self::single(
            Drawing {
                source: format!("data:image/svg+xml;base64,{}", STANDARD.encode(text)),
                size,
                enlarged: true,
                clear: false,
            },
            caption,
        )
    }

    fn single(drawing: Drawing, caption: impl Into<String>) -> Self {
        Self {
            shown: Shown::Single(drawing),
            caption: caption.into(),
            note: None,
        }
    }

    /// Compares two pictures, whose captions become labels: one over the other with a divider that can be moved if both have
    /// the same size, else side by side. Without a script in the browser, they are side by side, too.
    pub fn compared(before: Self, after: Self, caption: impl Into<String>) -> Self {
        let labels = [before.caption, after.caption];
        let shown = match (before.shown, after.shown) {
            (Shown::Single(before), Shown::Single(after)) => Shown::Pair {
                before,
                after,
                labels,
            },
            // two pairs or solids have no common divider: the later one is shown
            (_, after) => after,
        };
        Self {
            shown,
            caption: caption.into(),
            note: None,
        }
    }

    /// Adds measured figures in small print.
    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        self.note = Some(note.into());
        self
    }

    /// Lets the reader turn the solid that the picture shows, if there is one.
    pub fn with_solid(mut self, solid: Option<Solid>) -> Self {
        self.shown = match (self.shown, solid) {
            (Shown::Single(drawing) | Shown::Solid(drawing, _), Some(solid)) => {
                Shown::Solid(drawing, solid)
            }
            (shown, _) => shown,
        };
        self
    }

    /// True if the figure has a size of its own, as enlarged pixels have, instead of that of its column.
    pub(super) fn is_sized(&self) -> bool {
        match &self.shown {
            Shown::Single(drawing) | Shown::Solid(drawing, _) => drawing.enlarged,
            Shown::Pair { before, .. } => before.enlarged,
        }
    }

    /// True if the figure is a solid.
    pub(super) fn is_solid(&self) -> bool {
        matches!(self.shown, Shown::Solid(..))
    }

    /// The figure as HTML.
    pub(super) fn html(&self) -> String {
        let caption = escaped(&self.caption);
        let (class, shown) = match &self.shown {
            Shown::Single(drawing) => {
                let class = if drawing.enlarged { "sized" } else { "" };
                (class, drawing.html(&caption))
            }
            Shown::Pair {
                before,
                after,
                labels,
            } => {
                let alike = before.size == after.size
                    && !before.source.is_empty()
                    && !after.source.is_empty();
                let sides = [before, after].into_iter().zip(labels);
                let sides: Vec<_> = sides
                    .map(|(drawing, label)| {
                        let label = escaped(label);
                        let image = drawing.html(&label);
                        format!("<div class=\"side\">{image}<span>{label}</span></div>")
                    })
                    .collect();
                let class = match (alike, before.enlarged) {
                    (true, true) => "compare sized",
                    (true, false) => "compare",
                    (false, _) => "",
                };
                (
                    class,
                    format!("<div class=\"pair\">{}</div>", sides.concat()),
                )
            }
            Shown::Solid(drawing, solid) => {
                let image = drawing.html(&caption);
                let data = solid.json();
                let shown = format!(
                    "<div class=\"stage\">{image}</div><script type=\"application/json\">{data}</script>"
                );
                ("solid", shown)
            }
        };
        let class = if class.is_empty() {
            String::new()
        } else {
            format!(" class=\"{class}\"")
        };
        let note = self.note.as_deref().map_or(String::new(), |note| {
            format!("<small>{}</small>", escaped(note))
        });
        format!("<figure{class}>{shown}<figcaption>{caption}{note}</figcaption></figure>\n")
    }
}

impl Drawing {
    /// The picture as HTML; its description is escaped.
    fn html(&self, description: &str) -> String {
        let classes = [(self.enlarged, "pixels"), (self.clear, "clear")];
        let classes: Vec<_> = classes.iter().filter(|(is, _)| *is).collect();
        let class = if classes.is_empty() {
            String::new()
        } else {
            let names: Vec<_> = classes.iter().map(|(_, name)| *name).collect();
            format!(" class=\"{}\"", names.join(" "))
        };
        let [width, height] = self.size;
        format!(
            "<img{class} width=\"{width}\" height=\"{height}\" src=\"{}\" alt=\"{description}\">",
            self.source
        )
    }
}

/// The picture as a data address.
fn data_uri(picture: &Picture, format: Format) -> String {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let options = WriteOptions {
        quality: 90,
        ..WriteOptions::default()
    };
    // 8-bit pictures that are already in memory fit both formats; only a side beyond the format's limit can fail, and then
    // the caption stands alone
    if let Err(error) = encode(&mut bytes, format, picture, &options) {
        tracing::warn!("a figure was left out: {error}");
        return String::new();
    }
    let kind = if format == Format::Jpeg {
        "jpeg"
    } else {
        "png"
    };
    format!(
        "data:image/{kind};base64,{}",
        STANDARD.encode(bytes.into_inner())
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::Size;

    fn gray(width: usize, height: usize, alpha: f32) -> Image<LinearRgba> {
        let size = Size::new(width, height).unwrap();
        Image::new(size, LinearRgba([0.5, 0.2, 0.1, alpha]))
    }

    #[test]
    fn transparent_pictures_keep_their_alpha_and_empty_crops_their_caption() {
        let html = Figure::picture(&gray(2, 2, 0.5), "").html();
        assert!(html.contains("src=\"data:image/png"));
        assert!(html.contains("class=\"clear\""));
        let outside = Figure::crop(&gray(2, 2, 0.5), Rect::new(5, 5, 3, 3), 4, "nothing").html();
        assert!(outside.contains("src=\"\"") && outside.contains("<figcaption>nothing<"));
    }

    #[test]
    fn only_pictures_of_one_size_get_a_divider() {
        let pair = |width| {
            let before = Figure::picture(&gray(4, 3, 1.0), "a < b");
            let after = Figure::picture(&gray(width, 3, 1.0), "after");
            Figure::compared(before, after, "both").with_note("1 & 2")
        };
        let html = pair(4).html();
        assert!(html.starts_with("<figure class=\"compare\">"));
        assert!(
            html.contains("<span>a &lt; b</span>") && html.contains("<small>1 &amp; 2</small>")
        );
        assert!(pair(5).html().starts_with("<figure><div class=\"pair\">"));
        let nothing = Rect::new(9, 9, 1, 1);
        let empty = || Figure::crop(&gray(4, 3, 1.0), nothing, 2, "");
        let html = Figure::compared(empty(), empty(), "").html();
        assert!(!html.contains("compare"));
    }
}
