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
    let mp4 = CLIPS
        .iter()
        .map(|(name, content)| ("mp4", (*name).to_owned(), content.to_vec()));
    let y4m = [
        ("gray", "W4 H3 F25:1 Cmono", 12),
        (
            "deep",
            "W2 H2 F30000:1001 Ip A1:1 C420p10 XCOLORRANGE=FULL",
            12,
        ),
        ("alpha", "W2 H2 C444alpha", 16),
    ];
    let y4m = y4m.map(|(name, header, bytes)| {
        let mut content = format!("YUV4MPEG2 {header}\n").into_bytes();
        for frame in 0..2u8 {
            content.extend(b"FRAME\n");
            content.extend((0..bytes).map(|at| frame + 3 * at));
        }
        ("y4m", name.to_owned(), content)
    });
    mp4.chain(y4m).collect()
}
