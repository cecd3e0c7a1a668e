//! The end of the help pages of operations on planes.

/// Of `ravec rectify`.
pub const RECTIFY: &str = concat!(
    "\
Examples:
  ravec rectify photo.jpg -o front.png --quad 36,26,130,7,136,97,52,85 --aspect 4:3
  ravec rectify photo.jpg -o front.png --quad 36,26,130,7,136,97,52,85 --focal 28mm --whole
  ravec rectify photo.jpg -o front.png --quad 36,26,130,7,136,97,52,85 --aspect 4:3 --json f.json

The corners of a rectangle on the plane are given in turn, from the upper left one clockwise, in pixels, x right, y down; the center of \
the first pixel is (0.5, 0.5). Its proportions are those of --aspect; else they follow from the focal length, given or in the \
EXIF data; else from its right angles, if neither pair of sides is parallel in the picture. For both, the picture should not \
have been cropped.

Figures: aspect (width by height), aspect_sigma_percent (its standard deviation if each corner is a pixel off), angle_deg (between the \
sides, 90 for a rectangle), focal_px. In JSON, result has these, aspect_from (hand, focal, exif or right-angles), quad, size, and \
image_from_straight and straight_from_image, nine numbers each, row by row.

",
    exit_codes!()
);

/// Of `ravec snap`.
pub const SNAP: &str = concat!(
    "\
Examples:
  ravec snap photo.jpg --quad 36,26,130,7,136,97,52,85 --grid 4x3
  ravec snap photo.jpg --quad 36,26,130,7,136,97,52,85 --grid 4x3 -o grid.png

The corners of the grid are given in turn, from the upper left one clockwise, in pixels, x right, y down; the center of the first pixel \
is (0.5, 0.5). They should be within a few percent of the grid's diagonal of where they belong (--reach). Lines come to lie on \
edges, or in the middle of joints.

Standard output gets one object in JSON: quad (four corners [x, y]), columns, rows, support (the share of the lines that lies on an edge, \
0 to 1), moved_px (of each corner). With --json, it is result in the report.

Figures: support, moved_most_px.

",
    exit_codes!()
);

/// Of `ravec planes`.
pub const PLANES: &str = concat!(
    "\
Examples:
  ravec planes photo.jpg
  ravec planes photo.jpg -o planes.png --focal 28mm
  ravec planes photo.jpg --most 1 -o planes.json

Proposals are there to be chosen from: give the corners of one to ravec snap or ravec rectify.

Standard output gets one object in JSON: planes, the best first, each with quad (four corners [x, y] in pixels, clockwise from the upper \
left one), vanishing (the numbers of the points where its sides meet), support_px (the length of the edges along its sides) and \
right_angles (true, false, or null without a focal length); vanishing_points, each with at (homogeneous coordinates x, y, w) and \
length_px; focal_px, given or found, or null. With --json, it is result in the report.

Figures: planes, segments, vanishing_points, focal_px.

",
    exit_codes!()
);
