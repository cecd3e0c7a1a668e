//! PLY, binary of both byte orders and ASCII, as a stream.
//!
//! A header names *elements* (tables) and their properties (columns); rows follow, in binary back to back, in ASCII one a
//! line. Read are the columns `x`, `y`, `z` of the element `vertex`, the list `vertex_indices` (or `vertex_index`) of
//! `face`, and the same list of `tristrips`, where −1 ends a strip. If colors were requested, so are the columns `red`,
//! `green`, `blue` and `alpha` of the vertices. All other columns and elements are passed over.
//!
//! The two tables that make up nearly every file, vertices of fixed size and triangles with a list alone, are decoded
//! from whole buffers, at about 1 GB/s; any other goes column by column.

mod header;

use glam::DVec3;

use self::header::{Element, Encoding, Scalar};
use crate::error::{Place, ReadMeshError};
use crate::number::{integer, number, shown, words};
use crate::read::{MeshFile, ReadWarning};
use crate::soup::Soup;
use crate::source::Source;
use ravec_memory::ReservedVec;

/// Number of words of a line that are read between two checks for cancellation.
const AT_ONCE: u64 = 1 << 16;

const INDICES: [&[u8]; 3] = [b"vertex_indices", b"vertex_index", b"vertex_indexes"];

/// Role of the rows of an element, with its columns.
enum Role {
    Vertices(Columns),
    Faces(usize),
    Strips(usize),
    Nothing,
}

/// The columns of vertices.
#[derive(Clone, Copy)]
struct Columns {
    places: [usize; 3],
    /// Red, green and blue, if they are wanted and there.
    color: Option<[usize; 3]>,
    /// Comes with colors only.
    alpha: Option<usize>,
}

impl Columns {
    fn used(&self) -> impl Iterator<Item = usize> {
        let color = self.color.into_iter().flatten();
        self.places.into_iter().chain(color).chain(self.alpha)
    }
}

/// The names of columns of colors, in the order of [`Columns::color`].
const COLORS: [[&[u8]; 3]; 3] = [
    [b"red", b"diffuse_red", b"r"],
    [b"green", b"diffuse_green", b"g"],
    [b"blue", b"diffuse_blue", b"b"],
];

impl Role {
    fn of(element: &Element, source: &Source<'_>) -> Result<Self, ReadMeshError> {
        let missing = |what: &str| {
            let what = format!("the header names no {what}");
            Err(source.syntax(source.at_line(), what))
        };
        match element.name.as_slice() {
            b"vertex" => {
                let columns = [b"x", b"y", b"z"].map(|name| element.column(&[name], false));
                let [Some(x), Some(y), Some(z)] = columns else {
                    return missing("coordinates x, y and z of the vertices");
                };
                let color = match COLORS.map(|names| element.column(&names, false)) {
                    [Some(r), Some(g), Some(b)] if source.options().colors => Some([r, g, b]),
                    _ => None,
                };
                let alpha = color.and_then(|_| element.column(&[b"alpha", b"a"], false));
                Ok(Self::Vertices(Columns {
                    places: [x, y, z],
                    color,
                    alpha,
                }))
            }
            b"face" => match element.column(&INDICES, true) {
                Some(column) => Ok(Self::Faces(column)),
                None if element.rows == 0 => Ok(Self::Nothing),
                None => missing("list vertex_indices of the faces"),
            },
            b"tristrips" => match element.column(&INDICES, true) {
                Some(column) => Ok(Self::Strips(column)),
                None => Ok(Self::Nothing),
            },
            _ => Ok(Self::Nothing),
        }
    }
}

pub(super) fn read(mut source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    let header = header::read(&mut source)?;
    let encoding = header.encoding;
    let mut soup = Soup::new(source.format, &source.limits);
    for element in header.elements.iter() {
        let role = Role::of(element, &source)?;
        match role {
            Role::Vertices(_) => soup.claim(element.rows, 0)?,
            Role::Faces(_) => soup.claim(0, element.rows)?,
            Role::Strips(_) | Role::Nothing => {}
        }
        remark(element, &role, &mut soup);
        let mut table = Table {
            element,
            role,
            encoding,
            picked: [0.0; 3],
            color: [0, 0, 0, 255],
            list: ReservedVec::new(&source.limits.memory),
        };
        if let Role::Vertices(Columns { color: Some(_), .. }) = table.role {
            soup.claim_colors(element.rows);
        }
        table.read(&mut source, &mut soup)?;
    }
    let more = match encoding {
        Encoding::Ascii => source.content_line(None)?.is_some(),
        Encoding::Little | Encoding::Big => !source.peek(1)?.is_empty(),
    };
    if more {
        soup.warn(ReadWarning::MoreBehindTheEnd);
    }
    soup.finish(None, source.progress)
}

/// Says which columns are left out.
fn remark(element: &Element, role: &Role, soup: &mut Soup) {
    let used: Vec<usize> = match role {
        Role::Vertices(columns) => columns.used().collect(),
        Role::Faces(column) | Role::Strips(column) => vec![*column],
        Role::Nothing => {
            if element.rows > 0 {
                soup.ignore("elements other than vertices and faces");
            }
            return;
        }
    };
    for (i, property) in element.properties.iter().enumerate() {
        if used.contains(&i) {
            continue;
        }
        soup.ignore(match property.name.as_slice() {
            b"nx" | b"ny" | b"nz" => "normals",
            b"red" | b"green" | b"blue" | b"alpha" | b"diffuse_red" | b"diffuse_green"
            | b"diffuse_blue" | b"r" | b"g" | b"b" | b"a" => "colors",
            b"s" | b"t" | b"u" | b"v" | b"texture_u" | b"texture_v" | b"texcoord"
            | b"texnumber" => "texture coordinates",
            _ => "other properties",
        });
    }
}

/// A table while it is read.
struct Table<'a> {
    element: &'a Element,
    role: Role,
    encoding: Encoding,
    /// The three coordinates of the last row.
    picked: [f64; 3],
    /// The color of the last row.
    color: [u8; 4],
    /// The indices of the last row.
    list: ReservedVec<u32>,
}

impl Table<'_> {
    fn read(&mut self, source: &mut Source<'_>, soup: &mut Soup) -> Result<(), ReadMeshError> {
        let mut left = self.element.rows;
        while left > 0 {
            let many = match self.encoding {
                Encoding::Ascii => 0,
                Encoding::Little => self.rows_at_once(false, left, source, soup)?,
                Encoding::Big => self.rows_at_once(true, left, source, soup)?,
            };
            if many > 0 {
                left -= many;
                continue;
            }
            let row = self.element.rows - left;
            let place = match self.encoding {
                Encoding::Ascii => self.text_row(row, source, soup)?,
                Encoding::Little | Encoding::Big => self.binary_row(row, source, soup)?,
            };
            match self.role {
                Role::Vertices(columns) => {
                    soup.vertex(DVec3::from_array(self.picked), place)?;
                    if columns.color.is_some() {
                        soup.color(self.color)?;
                    }
                }
                Role::Faces(_) => soup.face(&self.list)?,
                Role::Strips(_) => {
                    for strip in self.list.split(|&index| index == STOP) {
                        for (i, corners) in strip.windows(3).enumerate() {
                            let [a, b, c] = [corners[0], corners[1], corners[2]];
                            soup.face(&if i % 2 == 0 { [a, b, c] } else { [b, a, c] })?;
                        }
                    }
                }
                Role::Nothing => {}
            }
            left -= 1;
        }
        Ok(())
    }

    /// Reads the rows that are buffered whole, if they are of one of the common kinds, and returns their number.
    fn rows_at_once(
        &mut self,
        big: bool,
        left: u64,
        source: &mut Source<'_>,
        soup: &mut Soup,
    ) -> Result<u64, ReadMeshError> {
        let offset = source.offset();
        match (&self.role, self.element.stride()) {
            (Role::Vertices(columns), Some(stride)) => {
                let offset_of = |column: usize| {
                    let before = &self.element.properties[..column];
                    let at: usize = before.iter().map(|property| property.item.size()).sum();
                    (self.element.properties[column].item, at)
                };
                let places = columns.places.map(offset_of);
                let color = columns.color.map(|color| color.map(offset_of));
                let alpha = columns.alpha.map(offset_of);
                let there = source.peek(stride)?;
                let rows = there.chunks_exact(stride);
                let mut done = 0;
                for row in rows.take(usize::try_from(left).unwrap_or(usize::MAX)) {
                    let at = places.map(|(scalar, at)| scalar.decode(&row[at..], big));
                    let place = Place::Byte(offset + (done * stride) as u64);
                    soup.vertex(DVec3::from_array(at), place)?;
                    if let Some(color) = color {
                        let level = |(scalar, at): (Scalar, usize)| {
                            level(scalar, scalar.decode(&row[at..], big))
                        };
                        let [r, g, b] = color.map(level);
                        soup.color([r, g, b, alpha.map_or(255, level)])?;
                    }
                    done += 1;
                }
                source.consume(done * stride);
                Ok(done as u64)
            }
            (Role::Nothing, Some(stride)) => {
                let bytes = left.checked_mul(stride as u64);
                if !bytes.map_or(Ok(false), |bytes| source.skip(bytes))? {
                    let name = shown(&self.element.name);
                    return Err(source.truncated(format!("the element {name}")));
                }
                Ok(left)
            }
            (Role::Faces(_), _) if self.element.is_plain_list() => {
                const ROW: usize = 13;
                let signed = self.element.properties[0].item == Scalar::I32;
                let there = source.peek(ROW)?;
                let rows = there.as_chunks::<ROW>().0;
                let mut done = 0;
                for row in rows
                    .iter()
                    .take(usize::try_from(left).unwrap_or(usize::MAX))
                {
                    if row[0] != 3 {
                        break;
                    }
                    let place = Place::Byte(offset + (done * ROW) as u64);
                    let word = |at: usize| {
                        let bytes = [row[at], row[at + 1], row[at + 2], row[at + 3]];
                        let bits = if big {
                            u32::from_be_bytes(bytes)
                        } else {
                            u32::from_le_bytes(bytes)
                        };
                        if signed {
                            i64::from(bits as i32)
                        } else {
                            i64::from(bits)
                        }
                    };
                    let corners = [
                        soup.index(word(1), 0, place)?,
                        soup.index(word(5), 0, place)?,
                        soup.index(word(9), 0, place)?,
                    ];
                    soup.face(&corners)?;
                    done += 1;
                }
                source.consume(done * ROW);
                Ok(done as u64)
            }
            _ => Ok(0),
        }
    }

    fn binary_row(
        &mut self,
        row: u64,
        source: &mut Source<'_>,
        soup: &mut Soup,
    ) -> Result<Place, ReadMeshError> {
        let big = self.encoding == Encoding::Big;
        let place = source.at_byte();
        let element = self.element;
        let inside = || format!("row {row} of the element {}", shown(&element.name));
        self.list.clear();
        for (column, property) in element.properties.iter().enumerate() {
            let mut next = |scalar: Scalar| match source.exact(scalar.size())? {
                Some(bytes) => Ok(scalar.decode(bytes, big)),
                None => Err(source.truncated(inside())),
            };
            match property.count {
                None => {
                    let value = next(property.item)?;
                    self.pick(column, value);
                }
                Some(count) => {
                    let count = self.length(next(count)?, place, source, soup)?;
                    if self.takes_list(column) {
                        for _ in 0..count {
                            let value = match source.exact(property.item.size())? {
                                Some(bytes) => property.item.decode(bytes, big),
                                None => return Err(source.truncated(inside())),
                            };
                            self.push(value, place, source, soup)?;
                        }
                    } else if !source.skip(count * property.item.size() as u64)? {
                        return Err(source.truncated(inside()));
                    }
                }
            }
        }
        Ok(place)
    }

    fn text_row(
        &mut self,
        row: u64,
        source: &mut Source<'_>,
        soup: &mut Soup,
    ) -> Result<Place, ReadMeshError> {
        let (format, progress) = (source.format, source.progress);
        let Some((line, place)) = source.content_line(None)? else {
            let name = shown(&self.element.name);
            return Err(source.truncated(format!("row {row} of the element {name}")));
        };
        let fault = |what: String| ReadMeshError::Syntax {
            format,
            place,
            what,
        };
        self.list.clear();
        let mut words = words(line);
        let mut next = || {
            words
                .next()
                .ok_or_else(|| fault("the row is too short".to_owned()))
        };
        let parsed = |word: &[u8]| {
            number(word).ok_or_else(|| fault(format!("`{}` is not a number", shown(word))))
        };
        for (column, property) in self.element.properties.iter().enumerate() {
            let word = next()?;
            if property.count.is_none() {
                // Values of other columns may be anything.
                if self.takes_number(column) {
                    let value = parsed(word)?;
                    self.pick(column, value);
                }
                continue;
            }
            let count = integer(word).and_then(|count| u64::try_from(count).ok());
            let count = count
                .ok_or_else(|| fault(format!("`{}` is not the length of a list", shown(word))))?;
            let wanted = self.takes_list(column);
            if wanted {
                self.check_length(count, soup)?;
            }
            for i in 0..count {
                if i % AT_ONCE == 0 {
                    progress.check()?;
                }
                let word = next()?;
                if wanted {
                    let index = integer(word)
                        .ok_or_else(|| fault(format!("`{}` is not an index", shown(word))))?;
                    self.push_index(index, place, soup)?;
                }
            }
        }
        Ok(place)
    }

    fn takes_number(&self, column: usize) -> bool {
        matches!(&self.role, Role::Vertices(columns) if columns.used().any(|used| used == column))
    }

    fn takes_list(&self, column: usize) -> bool {
        matches!(self.role, Role::Faces(wanted) | Role::Strips(wanted) if wanted == column)
    }

    fn pick(&mut self, column: usize, value: f64) {
        if let Role::Vertices(columns) = &self.role {
            for (picked, wanted) in self.picked.iter_mut().zip(columns.places) {
                if wanted == column {
                    *picked = value;
                }
            }
            let wanted = columns.color.into_iter().flatten();
            let wanted = wanted.chain(columns.alpha);
            for (picked, wanted) in self.color.iter_mut().zip(wanted) {
                if wanted == column {
                    *picked = level(self.element.properties[column].item, value);
                }
            }
        }
    }

    /// The length of a list.
    fn length(
        &self,
        count: f64,
        place: Place,
        source: &Source<'_>,
        soup: &Soup,
    ) -> Result<u64, ReadMeshError> {
        if count < 0.0 || count.fract() != 0.0 || !count.is_finite() || count > 4294967295.0 {
            return Err(source.syntax(place, format!("{count} is not the length of a list")));
        }
        let count = count as u64;
        if !matches!(self.role, Role::Nothing) {
            self.check_length(count, soup)?;
        }
        Ok(count)
    }

    /// Refuses a face that gives more triangles than are allowed before its corners are stored.
    fn check_length(&self, count: u64, soup: &Soup) -> Result<(), ReadMeshError> {
        // The stops of strips have to be stored, too.
        let least = match self.role {
            Role::Strips(_) => count / 4,
            _ => count.saturating_sub(2),
        };
        soup.check_room(least)
    }

    fn push(
        &mut self,
        value: f64,
        place: Place,
        source: &Source<'_>,
        soup: &mut Soup,
    ) -> Result<(), ReadMeshError> {
        if value.fract() != 0.0 || value.abs() > 4294967295.0 {
            return Err(source.syntax(place, format!("{value} is not an index")));
        }
        self.push_index(value as i64, place, soup)
    }

    fn push_index(
        &mut self,
        index: i64,
        place: Place,
        soup: &mut Soup,
    ) -> Result<(), ReadMeshError> {
        if index == -1 && matches!(self.role, Role::Strips(_)) {
            self.list.push(STOP)?;
        } else {
            self.list.push(soup.index(index, 0, place)?)?;
        }
        Ok(())
    }
}

/// A part of a color in 256 steps: whole numbers of 8 bits are that, of 16 bits finer; others run from 0 to 1.
fn level(scalar: Scalar, value: f64) -> u8 {
    let value = match scalar {
        Scalar::F32 | Scalar::F64 => 255.0 * value,
        Scalar::U16 => value / 257.0,
        _ => value,
    };
    // what is not a number becomes 0
    value.round().clamp(0.0, 255.0) as u8
}

/// Stands for the −1 that ends a strip. As an index it is out of range: a mesh has at most this many vertices.
const STOP: u32 = u32::MAX;
