//! Clips: the small files by which readers are tested.

use super::Seed;

const CLIPS: [(&str, &[u8]); 4] = [
    (
        "b-frames",
        include_bytes!("../../../crates/ravec-video/tests/fixtures/bframes.mp4"),
    ),
    (
        "edit-list",
        include_bytes!("../../../crates/ravec-video/tests/fixtures/cut.mp4"),
    ),
    (
        "fragments",
        include_bytes!("../../../crates/ravec-video/tests/fixtures/fragments.mp4"),
    ),
    (
        "tags",
        include_bytes!("../../../crates/ravec-video/tests/fixtures/tagged.mov"),
    ),
];

pub fn seeds() -> Vec<Seed> {
    CLIPS
        .iter()
        .map(|(name, content)| ("mp4", (*name).to_owned(), content.to_vec()))
        .collect()
}
