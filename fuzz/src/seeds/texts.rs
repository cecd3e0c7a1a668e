//! Strokes, steps, expressions, parameters and catalogues.

use super::Seed;
use ravec::progress::Progress;
use ravec_catalogue::Catalogue;
use ravec_media::Limits;

pub fn seeds() -> Vec<Seed> {
    let mut seeds: Vec<Seed> = TEXTS
        .iter()
        .map(|(target, name, text)| (*target, (*name).to_owned(), text.as_bytes().to_vec()))
        .collect();
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("a.ravec");
    let mut catalogue =
        Catalogue::open_or_make(&path, &Progress::none()).expect("an empty catalogue can be made");
    // any file will do: it becomes a row, be it of a picture that cannot be read
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).expect("the folder can be written to");
    for (name, content) in [("a.png", &b"no picture"[..]), ("b.bmp", b"BM none either")] {
        std::fs::write(photos.join(name), content).expect("the folder can be written to");
    }
    for (target, _, content) in super::pictures::seeds()
        .iter()
        .filter(|seed| seed.0 == "png")
    {
        std::fs::write(photos.join(format!("{}.{target}", content.len())), content)
            .expect("the folder can be written to");
    }
    ravec_catalogue::add(
        &mut catalogue,
        &[photos],
        &Limits::default(),
        &Progress::none(),
    )
    .expect("photos can be added");
    drop(catalogue);
    let content = std::fs::read(&path).expect("the catalogue is there");
    seeds.push(("catalogue_file", "photos".into(), content));
    seeds
}

/// Target, name and content.
const TEXTS: &[(&str, &str, &str)] = &[
    (
        "catalogue_rows",
        "usable",
        r#"[{"real":0,"hash":{"blob":[32,1]},"width":18,"height":16,"thumbnail_width":4,"thumbnail":{"blob":[48,90]}},
{"real":1,"hash":{"blob":[32,2]},"width":19,"height":16,"orientation":6,"taken":"2024:05:06 07:08:09","thumbnail_width":3,"thumbnail":[1,2,3,4,5,6,7,8,9]},
{"real":2,"hash":{"blob":[32,3]},"width":20,"height":16,"thumbnail_width":5,"thumbnail":{"blob":[75,200]},"flaw":"tiny"}]"#,
    ),
    (
        "catalogue_rows",
        "others",
        r#"[{"path":"/no/such.png","hash":{"blob":[32,7]},"bytes":12,"modified":5,"unreadable":"the file is empty"},
{"id":9,"path":"/b","hash":{"blob":[32,8]},"bytes":1,"modified":-5,"width":100,"height":3,"dropped":"near-duplicate of a","thumbnail_width":1,"thumbnail":[0,0,0]},
{"path":"/c","hash":{"blob":[32,9]},"bytes":9223372036854775807,"modified":0,"width":1,"height":4294967295,"thumbnail":null}]"#,
    ),
    (
        "strokes",
        "list",
        r##"[{"tool":"mask","points":[[10,10]],"radius_px":5},{"tool":"burn","points":[[3,4],[20,8.5]],"radius_px":4,"accumulate":true,"spacing":0.5},
{"tool":{"color":{"rgb":[1,2,250]}},"points":[[1,1]],"radius_px":2,"hardness":1,"strength":0.5,"edge_aware":false}]"##,
    ),
    (
        "strokes",
        "sized",
        r##"{"version":1,"width":48,"height":32,"strokes":[{"tool":{"operator":{"mode":"smooth","iterations":1}},"points":[[20,8],[24,9]],"radius_px":6,"window_px":5},
{"tool":{"clone":{"offset":[-4,3]}},"points":[[20,20]],"radius_px":3},{"tool":{"saturation":{"amount":-1}},"points":[[20,20],[20,20],[21,22]],"radius_px":3,"edge_tolerance":0.02},
{"tool":{"recolor":{"rgb":[200,20,20]}},"points":[[30,20]],"radius_px":3},{"tool":"dodge","points":[[5,5]],"radius_px":3}]}"##,
    ),
    ("strokes", "points", "[[1, 2], [3.5, 4e0], [20, 12]]"),
    (
        "steps",
        "plain",
        r#"{"width":64,"height":48,"steps":[{"target":{"at":[26,21],"radius_px":6},"source":{"at":[46.5,30.5]}},
{"target":{"at":[22.5,18.5],"radius_px":4,"shape":"square"},"source":{"photo":1,"at":[10,10],"transform":{"turn_rad":0.7,"mirrored":true,"scale":1.5}},"blend":false}]}"#,
    ),
    (
        "steps",
        "plane",
        r#"{"width":64,"height":48,"steps":[{"target":{"at":[26,21],"plane":0,"radius_px":5},"source":{"plane":0,"at":[44,20]}},
{"target":{"at":[26,21],"radius_px":5},"source":{"plane":0,"at":[12,20]}}]}"#,
    ),
    ("expression", "mixed", "(plate | rib) - hole & zone ^ a_1"),
    ("expression", "deep", "((((a))))-(b-(c-(d&(e^f))))|a"),
    ("parameters", "length", "0.1%"),
    ("parameters", "dimension", "1.5mm"),
    ("parameters", "view", "30,-15.5"),
    ("parameters", "cut", "-x=25%"),
    ("parameters", "cut-direction", "1,0.5,0=2"),
    ("parameters", "size", "1080x75%"),
    ("parameters", "quad", "0,0,9,0.5,9,9,0,9"),
    ("parameters", "grid", "4x6"),
    ("parameters", "focal", "28mm"),
    ("parameters", "ratio", "16:9"),
    ("parameters", "color", "#c03020"),
    ("parameters", "corners", "1,2, 3,4"),
    (
        "parameters",
        "brush",
        r##"{"mode":"clean","strength":0.5,"iterations":2,"window":9,"noise_sigma":3.5,"color":[1,2,3],"offset":[-4,5]}"##,
    ),
    (
        "parameters",
        "mosaic",
        r#"{"tiles":"80x60","tile_size":"12","crop":"center","max_uses":3,"seed":7,"blend":0.25}"#,
    ),
    (
        "parameters",
        "offset",
        r#"{"distance":"2%","tolerance":"0.1"}"#,
    ),
];
