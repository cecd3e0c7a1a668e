//! Parameters of mosaics.

use super::*;
use crate::ErrorKind;
use ravec::raster::{Image, Srgb};

#[test]
fn sides_are_one_number_or_two() {
    let sides = |text: &str| text.parse::<Sides>();
    assert_eq!(
        sides("80x60"),
        Ok(Sides {
            across: 80,
            down: Some(60)
        })
    );
    assert_eq!(sides("80").unwrap().to_string(), "80");
    for wrong in ["", "x", "0", "80x", "80x0", "-3", "3x4x5", "70000"] {
        assert_eq!(sides(wrong), Err(SidesError), "{wrong}");
    }
}

#[test]
fn parameters_out_of_range_are_refused() {
    for params in [
        Params {
            max_uses: Some(0),
            ..Params::default()
        },
        Params {
            degree: 6,
            ..Params::default()
        },
        Params {
            blend: f64::NAN,
            ..Params::default()
        },
        Params {
            detail: 1.5,
            ..Params::default()
        },
        Params {
            min_repeat_distance: -1.0,
            ..Params::default()
        },
        Params {
            feature_degree: Some(6),
            ..Params::default()
        },
        Params {
            feature_weight: 0.0,
            ..Params::default()
        },
        Params {
            rounds: 101,
            ..Params::default()
        },
        Params {
            tiling_rounds: Some(101),
            ..Params::default()
        },
        Params {
            quality: 0,
            ..Params::default()
        },
    ] {
        assert_eq!(checked(&params).unwrap_err().kind(), ErrorKind::Request);
    }
}

/// A folder with photos and their catalogue, and an operation that makes a mosaic of a picture in it.
fn collection() -> (tempfile::TempDir, Mosaic) {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().canonicalize().unwrap().join("photos");
    std::fs::create_dir(&photos).unwrap();
    let save = |path: &Path, number: usize, size: Size| {
        let image = Image::from_fn(size, |col, row| {
            let tone = |k: usize| (number * (31 + 26 * k) % 180) as u8;
            let slope = 60 * col / size.width();
            Srgb([tone(1) + slope as u8, tone(2), tone(3) + (row % 50) as u8])
        });
        let picture = Picture::from_image(image);
        ravec_media::write(path, &picture, &WriteOptions::default()).unwrap();
    };
    for number in 0..24 {
        let path = photos.join(format!("{number:02}.png"));
        save(&path, number, Size::new(60, 45).unwrap());
    }
    let input = folder.path().join("in.png");
    save(&input, 5, Size::new(160, 120).unwrap());
    let catalogue = folder.path().join("photos.ravec");
    let add = crate::catalogue::Add {
        paths: vec![photos],
        catalogue: catalogue.clone(),
        params: crate::catalogue::Plain::default(),
    };
    add.run(&Context::default()).unwrap();
    let mosaic = Mosaic {
        input,
        catalogue,
        output: Some(folder.path().join("out.png")),
        deep_zoom: None,
        params: Params {
            tiles: "8x6".parse().unwrap(),
            tile_size: Some("20x15".parse().unwrap()),
            min_repeat_distance: 2.0,
            ..Params::default()
        },
    };
    (folder, mosaic)
}

#[test]
fn pins_and_bans_are_texts_in_json() {
    let (_folder, mut mosaic) = collection();
    mosaic.params.pins = vec!["3,0:/photos/a.jpg".parse().unwrap()];
    mosaic.params.bans = vec![
        "/photos/b.jpg".parse().unwrap(),
        "1,2:/photos/c.jpg".parse().unwrap(),
    ];
    let json = serde_json::to_value(&mosaic).unwrap();
    assert_eq!(json["params"]["pins"], json!(["3,0:/photos/a.jpg"]));
    assert_eq!(
        json["params"]["bans"],
        json!(["/photos/b.jpg", "1,2:/photos/c.jpg"])
    );
    assert_eq!(serde_json::from_value::<Mosaic>(json).unwrap(), mosaic);
}

#[test]
fn a_mosaic_in_memory_is_that_of_the_file() {
    let (_folder, mosaic) = collection();
    let written = mosaic.run(&Context::default()).unwrap();
    let output = mosaic.output.clone().unwrap();
    let file = ravec_media::read(&output, &ravec_media::Limits::default()).unwrap();
    let context = Context::default().with_intermediates();
    let in_memory = Mosaic {
        output: Some("@1".into()),
        ..mosaic
    };
    let kept = in_memory.run(&context).unwrap();
    let picture = context.picture(Path::new("@1")).unwrap();
    assert_eq!(picture.image, file.image);
    assert_eq!(kept.result, written.result);
    assert_eq!(kept.outputs[0].width, Some(160));
}

#[test]
fn a_desk_gives_previews_and_candidates_that_can_be_pinned() {
    let (_folder, mut mosaic) = collection();
    let context = Context::default();
    let picture = ravec_media::read(&mosaic.input, &context.limits).unwrap();
    let mut desk = MosaicDesk::open(&mosaic, &context).unwrap();
    let preview = desk.preview(&mosaic, &picture, &context).unwrap();
    let whole = Size::new(160, 90).unwrap();
    assert_eq!(preview.size, whole);
    mosaic.params.preview = true;
    let key = MosaicDesk::key(&mosaic).unwrap();
    mosaic.run(&context).unwrap();
    let output = mosaic.output.clone().unwrap();
    let file = ravec_media::read(&output, &context.limits).unwrap();
    assert_eq!(preview.picture.image, file.image);
    mosaic.params.preview = false;

    let report = mosaic.run(&context).unwrap().result.unwrap();
    let tile = 2 * 8 + 3;
    let place: [usize; 4] = serde_json::from_value(report["places"][tile].clone()).unwrap();
    assert_eq!(place, [60, 30, 20, 15]);
    let [col, row, width, height] = place;
    let place = ravec::raster::Rect::new(col, row, width, height);
    let found = desk
        .candidates(&mosaic, &picture, place, 6, &context)
        .unwrap();
    assert_eq!(found.len(), 6);
    assert!(found.is_sorted_by(|a, b| a.distance <= b.distance));
    let wanted = &found[5].photo;
    assert_eq!(desk.small(wanted), Some(&found[5].small));
    let pinned = PinnedPhoto {
        tile: [3, 2],
        photo: wanted.clone(),
    };
    mosaic.params.pins = vec![pinned];
    let report = mosaic.run(&context).unwrap().result.unwrap();
    assert_eq!(report["photos"][tile], wanted.to_str().unwrap());
    // what is set by hand needs no other photos
    assert_eq!(MosaicDesk::key(&mosaic).unwrap(), key);
    mosaic.params.tile_size = Some("20x20".parse().unwrap());
    assert_ne!(MosaicDesk::key(&mosaic).unwrap(), key);
}

#[test]
fn the_gap_of_costs_is_no_ratio_of_roundings() {
    assert_eq!(gap_percent(3.0, 2.0, 100), 50.0);
    assert_eq!(gap_percent(2.0, 2.5, 100), 0.0);
    // tiles that are photos of the catalogue
    assert_eq!(gap_percent(2e-7, 1e-12, 100), 0.0);
    assert_eq!(gap_percent(0.4, 2e-12, 100), f64::INFINITY);
    assert_eq!(gap_percent(0.0, 0.0, 100), 0.0);
}
