//! Of the operations on meshes.

/// Of `ravec mesh`.
pub const MESH: &str = concat!(
    "\
Examples:
  ravec mesh info part.stl
  ravec mesh check part.stl
  ravec mesh render part.stl -o part.png

Meshes are STL, PLY, OBJ, OFF, 3MF, GLB or glTF, told apart by their content.

",
    exit_codes!()
);

/// Of `ravec mesh info`.
pub const INFO: &str = concat!(
    "\
Examples:
  ravec mesh info part.stl
  ravec mesh info part.stl -q --json part.json
  ravec mesh info - <part.stl

Figures: triangles, vertices, edges, parts (what shares a vertex hangs together), closed, manifold and oriented (0 or 1), \
boundary_edges; min_x to max_z, size_x to size_z and diagonal of the bounding box; area; volume, if the surface is closed and \
oriented (negative if inside out); side_min, side_mean and side_max of the triangles' sides; genus, the number of handles, if the \
surface is also manifold. Lengths are in units of the file.

",
    exit_codes!()
);

/// Of `ravec mesh check`.
pub const CHECK: &str = concat!(
    "\
Examples:
  ravec mesh check part.stl
  ravec mesh check part.stl --no-intersections --list 3
  ravec mesh check sheet.obj --open --weld 0.001%

Defects, each with its first places: degenerate triangles (without area), duplicate triangles, non-manifold edges (of more \
than two triangles), pinched vertices (whose triangles form more than one fan), orientation clashes (neighbors that face \
opposite sides), boundary loops and edges (but with --open), self-intersections, a surface that is inside out, a mesh without \
triangles. Unused vertices are listed but no defect. Vertices and triangles are counted from 0. All is decided by exact \
arithmetic.

Figures: those of info that are counts, euler, and the number of each defect; self_intersections is the sum of pairs that are \
crossing, overlapping within a plane, coincident or touching. In JSON, findings hold all places, and passed the verdict.

",
    exit_codes!()
);

/// Of `ravec mesh convert`.
pub const CONVERT: &str = concat!(
    "\
Examples:
  ravec mesh convert part.stl -o part.ply
  ravec mesh convert part.stl -o part.3mf --from-unit inch --unit millimeter
  ravec mesh convert part.stl -o text.stl --ascii --precision single
  ravec mesh convert sheet.obj -o welded.off --weld 0.001%
  ravec mesh convert - -o - --format obj <part.stl >part.obj

Colors of the vertices of PLY files and texture coordinates of OBJ and glTF files go along where the output has room for them, unless \
vertices are welded.

Figures: scale of the coordinates, if units differ; largest_rounding of a coordinate, if the output holds 32-bit floats; \
welded_vertices and collapsed_triangles, with --weld.

",
    exit_codes!()
);

/// Of `ravec mesh compare`.
pub const COMPARE: &str = concat!(
    "\
Examples:
  ravec mesh compare part.stl other.ply
  ravec mesh compare part.stl other.ply --tolerance 0.01% --within 5%
  ravec mesh compare part.stl other.ply -q --json distance.json

Figures: distance_lower and distance_upper, which enclose the largest distance of a point of one surface to the other surface; \
distance_percent, the upper bound in percent of diagonal, that of the bounding box of A; a_to_b_lower, a_to_b_upper, a_to_b_mean \
and a_to_b_rms (root mean square) for the points of A, and b_to_a_... for those of B. The bounds hold for all points; means \
are taken from evenly spread samples. With --within, passed is the verdict.

",
    exit_codes!()
);

/// Of `ravec mesh render`.
pub const RENDER: &str = concat!(
    "\
Examples:
  ravec mesh render part.stl -o part.png
  ravec mesh render part.stl -o part.png --view 30,20 --perspective --edges --width 640 --height 480
  ravec mesh render part.stl -o cut.png --section=-y=40% --transparent
  ravec mesh render other.ply -o distance.png --compare part.stl --range 2%
  ravec mesh render part.stl -o - --view front --up y >front.png

Colors of distances go from violet (nothing) over green to yellow; with --expected from blue (too near) over gray to red (too \
far).

Figures, with --compare: distance_min, distance_mean and distance_max at vertices, and color_low and color_high, the values \
at the ends of the scale of colors.

",
    exit_codes!()
);

/// Of `ravec mesh simplify`.
pub const SIMPLIFY: &str = concat!(
    "\
Examples:
  ravec mesh simplify part.stl -o small.stl --triangles 200
  ravec mesh simplify part.stl -o close.3mf --error 0.1%
  ravec mesh simplify part.stl -o both.ply --triangles 100 --error 2% --feature-angle 30

A closed surface stays closed, and one without intersections stays without them. `ravec mesh compare` proves how far the \
result is from the original.

Figures: triangles_before, triangles_after, vertices_after, feature_edges (kept as such), collapses; largest_error, with \
--error; target_reached (0 or 1), with --triangles.

",
    exit_codes!()
);
