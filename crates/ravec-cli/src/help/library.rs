//! The end of the help pages of catalogues and mosaics.

/// Of `ravec library`.
pub const LIBRARY: &str = concat!(
    "\
Examples:
  ravec library add photos --catalogue photos.ravec
  ravec library clean --catalogue photos.ravec --dry-run
  ravec library stats --catalogue photos.ravec

The catalogue is one file. It stays valid if the program is stopped at any moment or the power fails, and several programs may use \
it at once: they wait for one another, up to a minute. Photos are only read, and no output may take the place of one.

",
    exit_codes!()
);

/// Of `ravec library add`.
pub const ADD: &str = concat!(
    "\
Examples:
  ravec library add photos --catalogue photos.ravec
  ravec library add photo.jpg noisy.jpg --catalogue photos.ravec

What is known is not looked at again, so that an interrupted run goes on where it was. Files that moved are recognized by their \
content. Photos wait for memory, and one that alone needs more than --max-bytes is left out with a warning. Pieces of pages that \
zoom are passed by.

Figures: new, changed, moved, unchanged, copies (of other files), unreadable.

",
    exit_codes!()
);

/// Of `ravec library remove`.
pub const REMOVE: &str = concat!(
    "\
Examples:
  ravec library remove photo.jpg --catalogue photos.ravec

Figures: removed.

",
    exit_codes!()
);

/// Of `ravec library list`.
pub const LIST: &str = concat!(
    "\
Examples:
  ravec library list --catalogue photos.ravec

Standard output gets a list in JSON of objects with path, width, height, orientation (1 to 8 as in EXIF), taken (when), unreadable, \
flaw and dropped (reasons, or null). With --json, it is result in the report.

Figures: photos.

",
    exit_codes!()
);

/// Of `ravec library clean`.
pub const CLEAN: &str = concat!(
    "\
Examples:
  ravec library clean --catalogue photos.ravec --dry-run
  ravec library clean --catalogue photos.ravec

Standard output gets a list in JSON of objects with path and reason: unreadable, tiny, contentless, framed, near-duplicate or missing, \
and details. With --json, it is result in the report. Photos that were taken out of use are not added again.

Figures: dropped.

",
    exit_codes!()
);

/// Of `ravec library stats`.
pub const STATS: &str = concat!(
    "\
Examples:
  ravec library stats --catalogue photos.ravec

Figures: usable, landscape, portrait, square, unreadable, dropped, bytes (of all files).

",
    exit_codes!()
);

/// Of `ravec mosaic`.
pub const MOSAIC: &str = concat!(
    "\
Examples:
  ravec mosaic photo.jpg --catalogue photos.ravec -o mosaic.png --tiles 4x3 --crop center
  ravec mosaic photo.jpg --catalogue photos.ravec -o mosaic.jpg --tiles 3 --tile-size 32x24
  ravec mosaic photo.jpg --catalogue photos.ravec --deep-zoom zoom --tiles 4 --tile-size 256x192
  ravec mosaic photo.jpg --catalogue photos.ravec -o look.png --tiles 4x3 --crop center --preview
  ravec mosaic photo.jpg --catalogue photos.ravec -o f.png --tiles 4 --tile-size 36x27 --adaptive

Photos are scaled, and with --crop center cut to the proportions of a tile; they are never recolored or overlaid. Near-duplicates \
count as one photo. The mosaic is written row by row and may be much larger than the memory, up to --max-pixels; TIFF files beyond \
4 GiB become BigTIFF.

--deep-zoom makes a folder whose index.html shows the mosaic in a browser, without a network: wheel, drag and click, or the keys \
+ - arrows Enter Esc, lead into single photos, whose names are shown. mosaic.dzi there is for other viewers of Deep Zoom images. A \
larger --tile-size gives larger photos. The folder may be new, empty, or an older page, which is replaced; ravec-manifest.json there \
lists the files of a page, and a folder with anything else in it, or with a changed file, is refused.

--adaptive takes larger tiles where the picture is homogeneous and smaller ones where it has detail, off the grid, at most as many as \
there would be on it. --tile-size must be a multiple of 3. --feature-degree compares tiles through which an edge runs by their \
structure, and the others by --degree.

--preview takes the small pictures in the catalogue in place of the photos, for trying out the other options.

Figures: columns, rows, tiles, features (tiles with an edge), photos (that fit the tiles), different (of these, to the eye), used, most_uses, nearest_repeat (in tiles; \
infinite, or null in JSON, if no photo is there twice), cost (weighted squared differences in Oklab), cost_bound (below which no \
choice can be), cost_gap_percent, changes (of the improvement). In JSON, result has photos, the path of each tile's photo, \
and places, the left and upper border, width and height of each tile.

",
    exit_codes!()
);
