//! The page: the viewer, with the data that it shows.
//!
//! Names of photos and of the folder come from outside. They are data of the page, never its text, its policy lets nothing run
//! but its own script, and characters that change how a line is read are shown by their number.

use crate::pyramid::PIECE_PX;
use ravec_raster::{Rect, Size};
use serde_json::json;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;

const VIEWER: &str = include_str!("../viewer.html");

/// The place in the viewer where its data go.
const DATA: &str = "DATA</script>";

/// The page of a mosaic of `size`. `photos` has the file of each tile and where the tile is.
pub(super) fn page<'a>(
    title: &str,
    size: Size,
    levels: usize,
    photos: impl Iterator<Item = (&'a Path, Rect)>,
) -> String {
    let mut numbers: HashMap<&Path, usize> = HashMap::new();
    let (mut names, mut tiles) = (Vec::new(), Vec::new());
    for (path, place) in photos {
        let number = *numbers.entry(path).or_insert_with(|| {
            names.push(shown(
                &path.file_name().unwrap_or_default().to_string_lossy(),
            ));
            names.len() - 1
        });
        tiles.extend([place.col, place.row, place.width, place.height, number]);
    }
    let data = json!({
        "title": shown(title),
        "width": size.width(),
        "height": size.height(),
        "piece": PIECE_PX,
        "levels": levels,
        "names": names,
        "tiles": tiles,
    });
    // no name may end the data
    let data = data.to_string().replace('<', "\\u003c");
    VIEWER.replacen(DATA, &format!("{data}</script>"), 1)
}

/// A text from outside with characters by their number that are not seen themselves: controls, and those that turn the
/// direction of what follows.
fn shown(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        let turns = matches!(c, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}');
        if c.is_control() || turns {
            // a String takes every write
            let _ = write!(shown, "\\u{{{:x}}}", u32::from(c));
        } else {
            shown.push(c);
        }
    }
    shown
}

/// The description for other viewers of Deep Zoom images.
pub(super) fn description(size: Size) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<Image xmlns=\"http://schemas.microsoft.com/deepzoom/2008\" Format=\"jpg\" \
         Overlap=\"0\" TileSize=\"{PIECE_PX}\">\n  <Size Width=\"{}\" Height=\"{}\"/>\n</Image>\n",
        size.width(),
        size.height()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use sha2::{Digest as _, Sha256};

    /// The text between two others.
    fn between<'a>(text: &'a str, begin: &str, end: &str) -> &'a str {
        let rest = text.split_once(begin).unwrap().1;
        rest.split_once(end).unwrap().0
    }

    #[test]
    fn names_are_data_that_cannot_break_the_page() {
        let evil = Path::new("/photos/<!--<script>\"x\".jpg");
        let size = Size::new(20, 10).unwrap();
        let page = page(
            "</title>DATA</script>",
            size,
            5,
            [(evil, Rect::of(size))].into_iter(),
        );
        let data = between(&page, "type=\"application/json\">", "</script>");
        let data: serde_json::Value = serde_json::from_str(data).unwrap();
        assert_eq!(data["names"][0], "<!--<script>\"x\".jpg");
        assert_eq!(data["title"], "</title>DATA</script>");
        assert_eq!(page.matches("<script").count(), 2);
        assert_eq!(page.matches("</script").count(), 2);
    }

    #[test]
    fn characters_that_are_not_seen_are_shown_by_their_number() {
        let name =
            Path::new("/photos/a\u{1b}[2J\u{202e}gpj.exe\u{7f}\u{85}\u{2066}\n\t é 日 👩.jpg");
        let size = Size::new(20, 10).unwrap();
        let page = page(
            "t\u{9b}\u{200f}",
            size,
            5,
            [(name, Rect::of(size))].into_iter(),
        );
        let data = between(&page, "type=\"application/json\">", "</script>");
        let data: serde_json::Value = serde_json::from_str(data).unwrap();
        assert_eq!(
            data["names"][0],
            "a\\u{1b}[2J\\u{202e}gpj.exe\\u{7f}\\u{85}\\u{2066}\\u{a}\\u{9} é 日 👩.jpg"
        );
        assert_eq!(data["title"], "t\\u{9b}\\u{200f}");
    }

    #[test]
    fn the_policy_lets_only_the_own_script_and_style_run() {
        use base64::Engine as _;
        let size = Size::new(20, 10).unwrap();
        let page = page("title", size, 5, std::iter::empty());
        let hash = |begin, end| {
            let hash = Sha256::digest(between(&page, begin, end));
            base64::engine::general_purpose::STANDARD.encode(hash)
        };
        let policy = between(&page, "\"Content-Security-Policy\" content=\"", "\">");
        let script = hash("<script>", "</script>");
        let style = hash("<style>", "</style>");
        assert_eq!(
            policy,
            format!(
                "default-src 'none'; img-src 'self'; script-src 'sha256-{script}'; style-src 'sha256-{style}'; base-uri \
                 'none'; form-action 'none'"
            )
        );
        // what the policy would refuse is not there
        assert!(
            !page.contains(" style=") && !page.contains(" onload=") && !page.contains(" onclick=")
        );
        // nothing that is shown is taken for text of a page
        assert!(!page.contains("innerHTML") && !page.contains("document.write"));
    }
}
