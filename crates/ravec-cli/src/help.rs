//! The end of each help page: examples, the form of input files, exit codes.
//!
//! The examples are run by the tests as they are written here, with `photo.jpg` and the like in the folder. Paragraphs are one
//! line each, which is broken to the width of the terminal.

/// Exit codes of the program.
macro_rules! exit_codes {
    () => {
        "\
Exit codes:
    0  done
    1  the operation failed, or its verdict is no: a mesh has defects, a distance is too large
    2  the command line is wrong
    3  an input cannot be read, is no valid picture or mesh, or exceeds a limit
    4  an output cannot be written
    5  an output was written, but is not what was promised: an offset is not proved or not solid, a combined mesh not solid
  130  interrupted by Ctrl-C; nothing half-written is left"
    };
}

pub mod library;
pub mod mesh;
pub mod planes;

/// Of the whole program.
pub const PROGRAM: &str = concat!(
    "\
Examples:
  ravec demo
  ravec demo --image photo.jpg --out gallery
  ravec twocolor photo.jpg -o blocks.png
  ravec mesh check part.stl

Pictures are PNG, JPEG, WebP, TIFF, BMP, OpenEXR or Radiance HDR, meshes are STL, PLY, OBJ, OFF, 3MF, GLB or glTF, told apart by \
their content. An output replaces an older \
file of its name once it is whole, but never an input.

",
    exit_codes!()
);

/// Of `ravec match`.
pub const MATCH: &str = concat!(
    "\
Examples:
  ravec match poster.jpg street.jpg -o h.txt
  ravec match poster.jpg street.jpg -o - -q

The nine numbers h, row by row, lead from a point (x, y) of the first photo to (h1 x + h2 y + h3, h4 x + h5 y + h6) / (h7 x + h8 y + \
h9) in the second. Points are in pixels, x right, y down; the center of the first pixel is (0.5, 0.5).

Figures: matches, inliers, patches, sigma_px, tilted (0 or 1).

",
    exit_codes!()
);

/// Of `ravec complete`.
pub const COMPLETE: &str = concat!(
    "\
Examples:
  ravec complete photo.jpg --polygon 40,30,70,28,72,60,41,58 -o without.png
  ravec complete photo.jpg --mask mask.png -o without.png --plane 10,8,110,20,108,70,12,80
  ravec complete photo.jpg --mask mask.png -o without.png --engine fragments --steps steps.json
  ravec complete photo.jpg --mask mask.png -o without.png --replay steps.json
  ravec complete photo.jpg --mask mask.png -o without.png --target 70,50 --source noisy.jpg

Points are in pixels, x right, y down; the center of the first pixel is (0.5, 0.5). Pixels that are not masked stay as they are, \
bit for bit.

With --radius, --target, --mirror, --turn, --scale, --features, --source, --replay or --steps the hole is filled by fragments, \
which are copied one by one; without them as a whole.

Figures: hole_px; with offsets thin_px, plane_px, parts, proposals, offsets, sourceless_px; with fragments steps, replaced, \
buffers, index_bytes_per_px, open_px.

",
    exit_codes!()
);

/// Of `ravec retarget`.
pub const RETARGET: &str = concat!(
    "\
Examples:
  ravec retarget photo.jpg -o square.png --size 100x100
  ravec retarget photo.jpg -o narrow.jpg --size 75%x100% --protect mask.png --show-grid grid.svg
  ravec retarget photo.jpg -o 'out-{size}.png' --size 60x120 --size 160x60 --size 50% --crop 0.2

If both sides change by the same factor, the result is plain scaling. A side may change to between 1/20 and 20 times its length.

Figures: cells, unknowns and straight_runs of the analysis, mean_importance (0 to 1); of all sizes the most bounded_edges (kept \
from folding), plain_share (plain scaling mixed in to prove that nothing folds) and cropped (share of a side), and the least_area \
of a cell against plain scaling. With --json the result lists these for each size.

",
    exit_codes!()
);

/// Of `ravec compare`.
pub const COMPARE: &str = concat!(
    "\
Examples:
  ravec compare photo.jpg noisy.jpg
  ravec compare photo.jpg noisy.jpg -q --json figures.json

Figures: psnr_db (infinite, or null in JSON, for equal pictures), ssim (1 for equal pictures), delta_e_mean, delta_e_p95 and \
delta_e_max (CIEDE2000; 1 is just noticeable), max_difference_steps (of 255), max_alpha_difference, identical (0 or 1).

",
    exit_codes!()
);

/// Of `ravec twocolor`.
pub const TWOCOLOR: &str = concat!(
    "\
Examples:
  ravec twocolor photo.jpg -o blocks.png --size 8
  ravec twocolor photo.jpg -o large.png --size 4 --scale 4
  ravec twocolor photo.jpg --svg photo.svg --adaptive
  ravec twocolor - -o - --size 16 <photo.jpg >blocks.jpg

Figures: blocks, flat_blocks (of one color), values (stored numbers), psnr_db (at scale 1), svg_bytes.

",
    exit_codes!()
);

/// Of `ravec brush`.
pub const BRUSH: &str = concat!(
    "\
Examples:
  ravec brush noisy.jpg -o clean.png --mode clean --everywhere
  ravec brush noisy.jpg -o clean.png --mode clean --everywhere --noise-sigma 15
  ravec brush photo.jpg -o large.png --mode antialias --scale 3 --everywhere
  ravec brush photo.jpg -o look.jpg --mode abstract --iterations 3 --everywhere
  ravec brush photo.jpg -o red.png --mode color --color '#c03020' --radius 80 --stroke points.json
  ravec brush photo.jpg -o all.png --stroke strokes.json --mask mask.png
  echo '[[40, 30], [90, 50]]' | ravec brush photo.jpg -o light.png --mode dodge --stroke -

Strokes: points, in pixels from the upper left corner, are one stroke with the settings of the flags:
  [[40, 30], [90, 50]]
Strokes with settings of their own fit a picture of any size, because they say on which size they were drawn:
  {\"version\": 1, \"width\": 800, \"height\": 600, \"strokes\": [
    {\"tool\": {\"operator\": {\"mode\": \"smooth\"}}, \"points\": [[40, 30], [90, 50]], \"radius_px\": 20},
    {\"tool\": {\"color\": {\"rgb\": [192, 48, 32]}}, \"points\": [[200, 150]], \"radius_px\": 60},
    {\"tool\": \"mask\", \"points\": [[200, 150]], \"radius_px\": 60}]}
Tools:
  {\"operator\": {\"mode\": \"smooth\", \"iterations\": 1, \"noise_sigma\": null}}
  {\"color\": {\"rgb\": [192, 48, 32]}}
  {\"recolor\": {\"rgb\": [192, 48, 32]}}
  {\"saturation\": {\"amount\": 0.5}}
  {\"clone\": {\"offset\": [-40, 12]}}
  \"dodge\"
  \"burn\"
  \"mask\"
Settings of a stroke that may be left out, as they are then:
  \"hardness\": 0.5, \"strength\": 1, \"edge_aware\": true, \"edge_tolerance\": 0.08,
  \"window_px\": 9, \"accumulate\": false, \"spacing\": 0.25
A list [...] of such strokes is taken as drawn on the picture as it is.

Figures: strokes and touched_pixels with --stroke; noise_sigma_steps and compressed (0 or 1) with --mode clean.

",
    exit_codes!()
);

/// Of `ravec offset`.
pub const OFFSET: &str = concat!(
    "\
Examples:
  ravec offset part.stl -o grown.stl --distance 2% --side outer
  ravec offset part.stl -o hollow.3mf --distance 0.2mm --unit mm --side shell
  ravec offset other.ply -o around.ply --distance 5% --tolerance 0.5% --no-simplify
  ravec offset part.stl -o smaller.ply --distance=-1% --side inner -q --json smaller.json

The mesh may be any triangles: open, crossing, flipped, doubled. Only inner and shell need a closed one. Edges and corners that \
the offset has are sharp in the result. A triangle is proved if none of its points is nearer to the mesh than the distance less \
the tolerance, nor farther than their sum; the result is solid if it is closed, manifold and does not meet itself. If any of \
that fails, the result is written all the same, a warning says what is wrong, and the exit code is 5. Where coordinates become \
32-bit floats (STL, glTF), all this holds for the mesh in the file.

A length with a unit, as in 2mm, needs a file that names its own (3MF, glTF) or --unit.

Figures: distance, tolerance and diagonal (that of the bounding box), in units of the file that is written; certified and solid (0 or 1), \
uncertified_triangles, self_intersections; distance_least and distance_most, which are proved for every point of the surface, and \
distance_most_found, the most at corners and middles of its triangles; triangles, extracted_triangles (before they were merged), \
feature_edges (where the surface turns by more than 20 degrees); cells and deepest_level of the octree, the tiles it was grown in, mending_rounds, \
split_cells and filled_corners (repairs done in it). In JSON, passed is the verdict.

",
    exit_codes!()
);

/// Of `ravec boolean`.
pub const BOOLEAN: &str = concat!(
    "\
Examples:
  ravec boolean union part.stl other.ply -o all.stl
  ravec boolean difference part.stl other.ply -o cut.ply --origins cut.csv
  ravec boolean '(a | b) - a & b' part.stl other.ply -o both.ply --picture both.png
  ravec boolean 'part - drill' part=part.stl drill=other.ply -o drilled.3mf
  ravec boolean union part.stl other.ply -o hull.ply --inside outer-hull --report json

Names are letters, digits and underscores. & comes before the other operators, which go from left to right: a | b - c & d is \
(a | b) - (c & d). A file that the expression does not name is not read.

Meshes may be any triangles. A mesh stands for the places where its winding number is above one half (--inside positive); an open \
one is closed first: edges that nearly meet are joined, holes filled by surfaces of least area. What was assumed about a mesh \
is a warning and stands in the report. Triangles that no other mesh touches come out as they went in. The result is solid if it \
is closed, manifold and does not meet itself; if it is not, it is written all the same, a warning says what is wrong, and the exit code \
is 5. An empty result is an empty mesh, and no error. Binary STL and glTF round its vertices to 32-bit floats; a warning says if that does harm.

Colors of the vertices of PLY files follow into a PLY file, texture coordinates of OBJ and glTF files into one of these. --origins has a row for each triangle: mesh, triangle (none for one that \
closes a hole), whether it was turned, and whether it is whole.

Figures: triangles, kept_triangles, seam_edges, intersecting_pairs, mending_rounds, self_intersections, solid (0 or 1), volume; \
largest_rounding, where coordinates become 32-bit floats. In JSON, result is what was found out about each mesh, and passed the \
verdict.

",
    exit_codes!()
);

/// Of `ravec demo`.
pub const DEMO: &str = concat!(
    "\
Examples:
  ravec demo
  ravec demo --image photo.jpg --out gallery

Open index.html in the folder with a browser; it needs no other file.

",
    exit_codes!()
);

/// Of `ravec scenes`.
pub const SCENES: &str = concat!(
    "\
Examples:
  ravec scenes --out scenes --width 96 --height 64
  ravec scenes --out noisy --scene disc --scene wedge --noise-sigma 10
  ravec scenes --out damaged --scene line-art --width 320 --height 240 --jpeg 30

Each scene is a picture NAME.png (or NAME.jpg) and NAME.json, which says what it was drawn from.

",
    exit_codes!()
);

/// Of `ravec completions`.
pub const COMPLETIONS: &str = concat!(
    "\
Examples:
  ravec completions bash >ravec.bash
  ravec completions zsh >_ravec

",
    exit_codes!()
);

/// Of `ravec man`.
pub const MAN: &str = concat!(
    "\
Examples:
  ravec man >ravec.1
  ravec man --out pages

",
    exit_codes!()
);
