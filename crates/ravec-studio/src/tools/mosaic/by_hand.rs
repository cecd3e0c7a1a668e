//! Pins and bans among the parameters of an edit.

use crate::document::Edit;
use ravec_jobs::mosaic::{BannedPhoto, PinnedPhoto};
use serde_json::{Value, json};
use std::path::Path;

/// The photos that are pinned to tiles.
pub(super) fn pins(edit: &Edit) -> Vec<PinnedPhoto> {
    serde_json::from_value(edit.param("pins").clone()).unwrap_or_default()
}

/// The photos that are banned.
pub(super) fn bans(edit: &Edit) -> Vec<BannedPhoto> {
    serde_json::from_value(edit.param("bans").clone()).unwrap_or_default()
}

fn with(edit: &Edit, pins: &[PinnedPhoto], bans: &[BannedPhoto]) -> Edit {
    let list = |empty: bool, list: Value| if empty { Value::Null } else { list };
    edit.with_param("pins", list(pins.is_empty(), json!(pins)))
        .with_param("bans", list(bans.is_empty(), json!(bans)))
}

/// The edit with a photo pinned to a tile, in place of another one and of bans that would be in the way.
pub(super) fn with_pin(edit: &Edit, tile: [usize; 2], photo: &Path) -> Edit {
    let (mut pins, mut bans) = (pins(edit), bans(edit));
    pins.retain(|pin| pin.tile != tile);
    bans.retain(|ban| ban.photo != photo || ban.tile.is_some_and(|other| other != tile));
    let photo = photo.to_path_buf();
    pins.push(PinnedPhoto { tile, photo });
    with(edit, &pins, &bans)
}

/// The edit without the pin of a tile.
pub(super) fn without_pin(edit: &Edit, tile: [usize; 2]) -> Edit {
    let mut pins = pins(edit);
    pins.retain(|pin| pin.tile != tile);
    with(edit, &pins, &bans(edit))
}

/// The edit with a photo banned at a tile or everywhere, in place of pins that would be in the way.
pub(super) fn with_ban(edit: &Edit, tile: Option<[usize; 2]>, photo: &Path) -> Edit {
    let (mut pins, mut bans) = (pins(edit), bans(edit));
    let here = |other: [usize; 2]| tile.is_none_or(|tile| tile == other);
    pins.retain(|pin| pin.photo != photo || !here(pin.tile));
    bans.retain(|ban| ban.photo != photo || ban.tile.is_some_and(|other| !here(other)));
    let photo = photo.to_path_buf();
    bans.push(BannedPhoto { tile, photo });
    with(edit, &pins, &bans)
}

/// The edit without a ban.
pub(super) fn without_ban(edit: &Edit, ban: &BannedPhoto) -> Edit {
    let mut bans = bans(edit);
    bans.retain(|other| other != ban);
    with(edit, &pins(edit), &bans)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tools::with_params;

    fn texts(edit: &Edit) -> [Vec<String>; 2] {
        let pins = pins(edit).into_iter().map(String::from).collect();
        let bans = bans(edit).into_iter().map(String::from).collect();
        [pins, bans]
    }

    #[test]
    fn the_last_decision_about_a_photo_stands() {
        let edit = Edit {
            id: 1,
            operation: "mosaic".to_owned(),
            fields: with_params(json!({})),
            enabled: true,
            more_sizes: Vec::new(),
        };
        let [a, b] = ["/a.jpg", "/b.jpg"].map(Path::new);
        let pinned = with_pin(&with_pin(&edit, [1, 2], a), [3, 0], b);
        assert_eq!(texts(&pinned), [vec!["1,2:/a.jpg", "3,0:/b.jpg"], vec![]]);
        let other = with_pin(&pinned, [1, 2], b);
        assert_eq!(texts(&other), [vec!["3,0:/b.jpg", "1,2:/b.jpg"], vec![]]);
        let here = with_ban(&other, Some([1, 2]), b);
        assert_eq!(texts(&here), [vec!["3,0:/b.jpg"], vec!["1,2:/b.jpg"]]);
        let everywhere = with_ban(&here, None, b);
        assert_eq!(texts(&everywhere), [vec![], vec!["/b.jpg"]]);
        let back = with_pin(&everywhere, [0, 0], b);
        assert_eq!(texts(&back), [vec!["0,0:/b.jpg"], vec![]]);
        assert_eq!(without_pin(&back, [0, 0]), edit);
        let ban = &bans(&everywhere)[0];
        assert_eq!(without_ban(&everywhere, ban), edit);
    }
}
