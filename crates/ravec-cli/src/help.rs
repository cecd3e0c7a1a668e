//! The end of the help pages of the program and of groups; that of an operation is beside its struct.
//!
//! The examples are run by the tests as they are written here, with `photo.jpg` and the like in the folder. Paragraphs are one
//! line each, which is broken to the width of the terminal.

/// Exit codes of the program, on each page.
pub const EXIT_CODES: &str = "\
Exit codes:
    0  done
    1  the operation failed, or its verdict is no: a mesh has defects, a distance is too large
    2  the command line is wrong
    3  an input cannot be read, is no valid picture or mesh, or exceeds a limit
    4  an output cannot be written
    5  an output was written, but is not what was promised: an offset is not proved or not solid, a combined mesh not solid
  130  interrupted by Ctrl-C; nothing half-written is left";

/// Of the whole program.
pub const PROGRAM: &str = "\
Examples:
  ravec demo
  ravec demo --image photo.jpg --out gallery
  ravec twocolor photo.jpg -o blocks.png
  ravec mesh check part.stl

Pictures are PNG, JPEG, WebP, TIFF, BMP, OpenEXR or Radiance HDR, meshes are STL, PLY, OBJ, OFF, 3MF, GLB or glTF, told apart by \
their content. An output replaces an older \
file of its name once it is whole, but never an input.";

/// Of `ravec mesh`.
pub const MESH: &str = "\
Examples:
  ravec mesh info part.stl
  ravec mesh check part.stl
  ravec mesh render part.stl -o part.png

Meshes are STL, PLY, OBJ, OFF, 3MF, GLB or glTF, told apart by their content.";

/// Of `ravec video`.
pub const VIDEO: &str = "\
Examples:
  ravec video info clip.mp4
  ravec video convert clip.mp4 small.gif --size 50%
  ravec video frames clip.mp4 -o frame_%04d.png

Clips are MP4 and MOV with H.264, Y4M, numbered pictures, GIF and APNG, told apart by their content; others are read and written \
by FFmpeg, if it is installed.";

/// Of `ravec library`.
pub const LIBRARY: &str = "\
Examples:
  ravec library add photos --catalogue photos.ravec
  ravec library clean --catalogue photos.ravec --dry-run
  ravec library stats --catalogue photos.ravec

The catalogue is one file. It stays valid if the program is stopped at any moment or the power fails, and several programs may use \
it at once: they wait for one another, up to a minute. Photos are only read, and no output may take the place of one.";

/// Of `ravec studio`.
pub const STUDIO: &str = "\
Examples:
  ravec studio
  ravec studio photo.jpg

The studio is a program of its own, ravec-studio, which is looked for beside this one and on the path. Its projects are recipes: \
ravec run writes what the studio exports.";

/// Of `ravec completions`.
pub const COMPLETIONS: &str = "\
Examples:
  ravec completions bash >ravec.bash
  ravec completions zsh >_ravec";

/// Of `ravec man`.
pub const MAN: &str = "\
Examples:
  ravec man >ravec.1
  ravec man --out pages";
