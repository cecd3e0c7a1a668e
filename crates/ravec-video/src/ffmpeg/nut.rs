//! NUT, the container of FFmpeg for raw frames with exact time stamps: what goes through the pipes.
//!
//! The reader takes one track of video. It checks every length before it uses it, takes no memory that a header asks for,
//! and skips what it has no use for (indices, tags). It does not verify checksums: a pipe does not alter bytes. The writer
//! gives the simplest valid stream, a synchronization point and a complete header for each frame.
//!
//! Source: the NUT specification, version 3 (`nut.txt` of the project, 2008).

use std::io::{self, Read, Write};

const FILE_ID: &[u8; 25] = b"nut/multimedia container\0";
const MAIN: u64 = 0x4E4D_7A56_1F5F_04AD;
const STREAM: u64 = 0x4E53_1140_5BF2_F9DB;
const SYNCPOINT: u64 = 0x4E4B_E4AD_EECA_4569;
const INFO: u64 = 0x4E49_AB68_B596_BA78;

/// Bytes of a header that is kept. FFmpeg writes some hundred.
const MAX_HEADER: u64 = 1 << 16;
/// Bytes of a frame up to which headers may be left out of it.
const MAX_ELIDED: u64 = 4096;

mod flag {
    pub(super) const KEY: u64 = 1;
    pub(super) const END: u64 = 2;
    pub(super) const CODED_PTS: u64 = 8;
    pub(super) const STREAM_ID: u64 = 16;
    pub(super) const SIZE_MSB: u64 = 32;
    pub(super) const CHECKSUM: u64 = 64;
    pub(super) const RESERVED: u64 = 128;
    pub(super) const SIDE_DATA: u64 = 256;
    pub(super) const HEADER_IDX: u64 = 1024;
    pub(super) const MATCH_TIME: u64 = 2048;
    pub(super) const CODED: u64 = 4096;
    pub(super) const INVALID: u64 = 8192;
}

/// Why a stream cannot be read.
#[derive(Debug, thiserror::Error)]
pub(super) enum NutError {
    /// The stream ends inside of a packet, or the pipe fails.
    #[error("the stream of frames ends early: {0}")]
    Io(#[from] io::Error),
    /// A value is out of its range.
    #[error("the stream of frames is damaged: {0}")]
    Damaged(&'static str),
    /// A frame has another size than the first one.
    #[error("a frame has {found} bytes instead of {expected}")]
    FrameSize { found: u64, expected: u64 },
}

/// The meaning of one value of the first byte of a frame.
#[derive(Debug, Clone, Copy, Default)]
struct FrameCode {
    flags: u64,
    stream: u64,
    size_mul: u64,
    size_lsb: u64,
    pts_delta: i64,
    reserved: u64,
    header: u64,
}

/// Reads the frames of the first track.
#[derive(Debug)]
pub(super) struct NutReader<R> {
    input: R,
    codes: Box<[FrameCode; 256]>,
    /// Beginnings that frames leave out; the first is empty.
    headers: Vec<Vec<u8>>,
    time_bases: Vec<(u32, u32)>,
    time_base: usize,
    /// Bits of a time stamp that are written if the rest is that of the last frame.
    pts_bits: u32,
    last_pts: i64,
}

/// A frame whose content comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FrameHead {
    /// Time stamp in units of the time base.
    pub(super) pts: i64,
    header: usize,
}

impl<R: Read> NutReader<R> {
    /// Reads the headers up to the first frame or synchronization point; `None` if the stream is empty.
    pub(super) fn open(mut input: R) -> Result<Option<Self>, NutError> {
        let mut id = [0; FILE_ID.len()];
        if !fill_or_end(&mut input, &mut id)? {
            return Ok(None);
        }
        if &id != FILE_ID {
            return Err(NutError::Damaged("it does not begin as NUT"));
        }
        let mut reader = Self {
            input,
            codes: Box::new([FrameCode::default(); 256]),
            headers: vec![Vec::new()],
            time_bases: Vec::new(),
            time_base: 0,
            pts_bits: 0,
            last_pts: 0,
        };
        let mut code = [0; 8];
        reader.input.read_exact(&mut code)?;
        if u64::from_be_bytes(code) != MAIN {
            return Err(NutError::Damaged("the main header is missing"));
        }
        let header = reader.packet()?;
        reader.read_main(&mut &header[..])?;
        reader.input.read_exact(&mut code)?;
        if u64::from_be_bytes(code) != STREAM {
            return Err(NutError::Damaged("the header of the track is missing"));
        }
        let header = reader.packet()?;
        reader.read_stream(&mut &header[..])?;
        Ok(Some(reader))
    }

    /// Seconds per unit of time stamps, as a fraction.
    pub(super) fn time_base(&self) -> (u32, u32) {
        self.time_bases[self.time_base]
    }

    /// The head of the next frame, which must have `expected` bytes; `None` at the end. [`read_content`](Self::read_content)
    /// must follow, with all of these bytes.
    pub(super) fn next_head(&mut self, expected: u64) -> Result<Option<FrameHead>, NutError> {
        loop {
            let mut first = [0];
            if !fill_or_end(&mut self.input, &mut first)? {
                return Ok(None);
            }
            if first[0] == b'N' {
                self.skip_packet()?;
                continue;
            }
            let code = self.codes[usize::from(first[0])];
            if let Some(head) = self.read_head(code, expected)? {
                return Ok(Some(head));
            }
        }
    }

    /// Fills the pieces with the content of the frame, one after the other.
    pub(super) fn read_content(
        &mut self,
        head: FrameHead,
        pieces: &mut [&mut [u8]],
    ) -> Result<(), NutError> {
        let mut elided = &self.headers[head.header][..];
        for piece in pieces {
            let copied = elided.len().min(piece.len());
            piece[..copied].copy_from_slice(&elided[..copied]);
            elided = &elided[copied..];
            self.input.read_exact(&mut piece[copied..])?;
        }
        Ok(())
    }

    /// The rest of the head of a frame; `None` for one without content, which marks the end of a track.
    fn read_head(&mut self, code: FrameCode, expected: u64) -> Result<Option<FrameHead>, NutError> {
        let input = &mut self.input;
        let mut flags = code.flags;
        if flags & flag::CODED != 0 {
            flags ^= read_v(input)?;
        }
        if flags & flag::INVALID != 0 {
            return Err(NutError::Damaged("a frame begins with an invalid code"));
        }
        if flags & flag::SIDE_DATA != 0 {
            return Err(NutError::Damaged("a frame has side data"));
        }
        let stream = if flags & flag::STREAM_ID != 0 {
            read_v(input)?
        } else {
            code.stream
        };
        if stream != 0 {
            return Err(NutError::Damaged("a frame of an unknown track"));
        }
        let pts = if flags & flag::CODED_PTS != 0 {
            full_pts(read_v(input)?, self.pts_bits, self.last_pts)
        } else {
            self.last_pts.checked_add(code.pts_delta)
        };
        let pts = pts.ok_or(NutError::Damaged("a time stamp is out of range"))?;
        let msb = if flags & flag::SIZE_MSB != 0 {
            read_v(input)?
        } else {
            0
        };
        let size = msb
            .checked_mul(code.size_mul)
            .and_then(|size| size.checked_add(code.size_lsb))
            .ok_or(NutError::Damaged("the size of a frame is out of range"))?;
        if flags & flag::MATCH_TIME != 0 {
            read_v(input)?;
        }
        let header = if flags & flag::HEADER_IDX != 0 {
            read_v(input)?
        } else {
            code.header
        };
        let reserved = if flags & flag::RESERVED != 0 {
            read_v(input)?
        } else {
            code.reserved
        };
        if reserved > 64 {
            return Err(NutError::Damaged("a frame has many reserved fields"));
        }
        for _ in 0..reserved {
            read_v(input)?;
        }
        if flags & flag::CHECKSUM != 0 {
            input.read_exact(&mut [0; 4])?;
        }
        self.last_pts = pts;
        if size == 0 && flags & flag::END != 0 {
            return Ok(None);
        }
        let header = if size > MAX_ELIDED { 0 } else { header };
        let header = usize::try_from(header)
            .ok()
            .filter(|header| *header < self.headers.len())
            .ok_or(NutError::Damaged("a frame leaves out an unknown header"))?;
        if size != expected || self.headers[header].len() as u64 > size {
            let found = size;
            return Err(NutError::FrameSize { found, expected });
        }
        Ok(Some(FrameHead { pts, header }))
    }

    /// Skips a packet whose first byte was read, or reads the time stamp of a synchronization point.
    fn skip_packet(&mut self) -> Result<(), NutError> {
        let mut code = [0; 8];
        code[0] = b'N';
        self.input.read_exact(&mut code[1..])?;
        if u64::from_be_bytes(code) == SYNCPOINT {
            let packet = self.packet()?;
            let value = read_v(&mut &packet[..])?;
            let count = self.time_bases.len() as u64;
            let (base, pts) = ((value % count) as usize, value / count);
            if base != self.time_base {
                return Err(NutError::Damaged("a foreign clock"));
            }
            self.last_pts = i64::try_from(pts)
                .map_err(|_| NutError::Damaged("a time stamp is out of range"))?;
            return Ok(());
        }
        let size = self.packet_size()?;
        let skipped = io::copy(&mut (&mut self.input).take(size), &mut io::sink())?;
        if skipped < size {
            return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
        }
        Ok(())
    }

    fn packet_size(&mut self) -> Result<u64, NutError> {
        let size = read_v(&mut self.input)?;
        if size > 4096 {
            self.input.read_exact(&mut [0; 4])?;
        }
        Ok(size)
    }

    /// The content of a packet after its start code, with the checksum at its end.
    fn packet(&mut self) -> Result<Vec<u8>, NutError> {
        let size = self.packet_size()?;
        if size > MAX_HEADER {
            return Err(NutError::Damaged("a header is too long"));
        }
        let mut bytes = vec![0; size as usize];
        self.input.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn read_main(&mut self, header: &mut &[u8]) -> Result<(), NutError> {
        let version = read_v(header)?;
        if !(2..=4).contains(&version) {
            return Err(NutError::Damaged("the version of NUT is unknown"));
        }
        if version > 3 {
            read_v(header)?;
        }
        if read_v(header)? != 1 {
            return Err(NutError::Damaged("there is not one track"));
        }
        read_v(header)?;
        let count = read_v(header)?;
        if count == 0 || count > 64 {
            return Err(NutError::Damaged("the number of clocks is out of range"));
        }
        for _ in 0..count {
            let part = |value| u32::try_from(value).ok().filter(|value| *value > 0);
            let (num, den) = (part(read_v(header)?), part(read_v(header)?));
            let base = num.zip(den).ok_or(NutError::Damaged("a clock of zero"))?;
            self.time_bases.push(base);
        }
        self.read_codes(header)?;
        let headers = read_v(header)?;
        if headers > 127 {
            return Err(NutError::Damaged("too many headers are left out"));
        }
        for _ in 0..headers {
            let bytes = read_bytes(header)?;
            self.headers.push(bytes.to_vec());
        }
        Ok(())
    }

    fn read_codes(&mut self, header: &mut &[u8]) -> Result<(), NutError> {
        let mut code = FrameCode {
            size_mul: 1,
            ..FrameCode::default()
        };
        let mut at = 0;
        while at < 256 {
            code.flags = read_v(header)?;
            let fields = read_v(header)?;
            if fields > 0 {
                code.pts_delta = read_s(header)?;
            }
            if fields > 1 {
                code.size_mul = read_v(header)?;
            }
            if fields > 2 {
                code.stream = read_v(header)?;
            }
            let size = if fields > 3 { read_v(header)? } else { 0 };
            code.reserved = if fields > 4 { read_v(header)? } else { 0 };
            let count = if fields > 5 {
                read_v(header)?
            } else {
                code.size_mul.saturating_sub(size)
            };
            if fields > 6 {
                read_s(header)?;
            }
            if fields > 7 {
                code.header = read_v(header)?;
            }
            for _ in 8..fields.max(8) {
                read_v(header)?;
            }
            if count == 0 || count > 256 {
                return Err(NutError::Damaged("the table of frame codes is broken"));
            }
            let mut used = 0;
            while used < count && at < 256 {
                if at == usize::from(b'N') {
                    self.codes[at].flags = flag::INVALID;
                } else {
                    let size_lsb = size.saturating_add(used);
                    self.codes[at] = FrameCode { size_lsb, ..code };
                    used += 1;
                }
                at += 1;
            }
        }
        Ok(())
    }

    fn read_stream(&mut self, header: &mut &[u8]) -> Result<(), NutError> {
        let (id, class) = (read_v(header)?, read_v(header)?);
        if id != 0 || class != 0 {
            return Err(NutError::Damaged("the track has no frames"));
        }
        read_bytes(header)?;
        self.time_base = usize::try_from(read_v(header)?)
            .ok()
            .filter(|base| *base < self.time_bases.len())
            .ok_or(NutError::Damaged("the clock of the track is missing"))?;
        self.pts_bits = u32::try_from(read_v(header)?)
            .ok()
            .filter(|bits| *bits <= 16)
            .ok_or(NutError::Damaged("the time stamps are out of range"))?;
        Ok(())
    }
}

/// A time stamp from what is written: its low bits, or all of it beyond them.
fn full_pts(coded: u64, bits: u32, last: i64) -> Option<i64> {
    let mask = (1u64 << bits) - 1;
    if coded > mask {
        return i64::try_from(coded - mask - 1).ok();
    }
    let delta = last.checked_sub((mask / 2) as i64)?;
    let low = (coded as i64).wrapping_sub(delta) & mask as i64;
    delta.checked_add(low)
}

/// Fills the buffer; false if the stream ends before its first byte.
fn fill_or_end(input: &mut impl Read, buffer: &mut [u8]) -> io::Result<bool> {
    let mut filled = 0;
    while filled < buffer.len() {
        match input.read(&mut buffer[filled..]) {
            Ok(0) if filled == 0 => return Ok(false),
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(true)
}

/// A number of 7 bits a byte.
fn read_v(input: &mut impl Read) -> Result<u64, NutError> {
    let mut value = 0u64;
    loop {
        let mut byte = [0];
        input.read_exact(&mut byte)?;
        if value >> 56 != 0 {
            return Err(NutError::Damaged("a number is too long"));
        }
        value = value << 7 | u64::from(byte[0] & 127);
        if byte[0] < 128 {
            return Ok(value);
        }
    }
}

/// A signed number.
fn read_s(input: &mut impl Read) -> Result<i64, NutError> {
    // at most 63 bits: the sum does not overflow
    let value = read_v(input)? + 1;
    let half = (value >> 1) as i64;
    Ok(if value & 1 != 0 { -half } else { half })
}

/// Bytes after their number.
fn read_bytes<'a>(header: &mut &'a [u8]) -> Result<&'a [u8], NutError> {
    let count = read_v(header)?;
    let count = usize::try_from(count)
        .ok()
        .filter(|count| *count <= header.len())
        .ok_or(NutError::Damaged("a header ends early"))?;
    let (bytes, rest) = header.split_at(count);
    *header = rest;
    Ok(bytes)
}

/// Properties of the track that is written.
#[derive(Debug, Clone, Copy)]
pub(super) struct NutTrack {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) pixel_aspect: (u32, u32),
    /// Seconds per unit of time stamps, in lowest terms.
    pub(super) time_base: (u32, u32),
    /// Frames a second, if even.
    pub(super) rate: Option<(u32, u32)>,
    /// Four characters by which FFmpeg knows the layout of the raw frames.
    pub(super) fourcc: [u8; 4],
}

/// Low bits of time stamps that a frame could write alone. They are always written in full.
const PTS_BITS: u32 = 7;

/// Writes the headers.
pub(super) fn write_headers(output: &mut impl Write, track: &NutTrack) -> io::Result<()> {
    output.write_all(FILE_ID)?;
    let mut main = Vec::new();
    for value in [3, 1, 65536, 1] {
        push_v(&mut main, value);
    }
    push_v(&mut main, track.time_base.0.into());
    push_v(&mut main, track.time_base.1.into());
    // the first code says that everything is written, all others are invalid
    for (flags, count) in [(flag::CODED, 1), (flag::INVALID, 254)] {
        for value in [flags, 6, 0, 1, 0, 0, 0, count] {
            push_v(&mut main, value);
        }
    }
    push_v(&mut main, 0);
    push_v(&mut main, 0);
    write_packet(output, MAIN, main)?;

    let mut stream = Vec::new();
    for value in [0, 0, 4] {
        push_v(&mut stream, value);
    }
    stream.extend(track.fourcc);
    for value in [0, u64::from(PTS_BITS), 1 << 20, 0, 1, 0] {
        push_v(&mut stream, value);
    }
    let (aspect_x, aspect_y) = track.pixel_aspect;
    for value in [track.width, track.height, aspect_x, aspect_y, 0] {
        push_v(&mut stream, value.into());
    }
    write_packet(output, STREAM, stream)?;

    if let Some((num, den)) = track.rate {
        let mut info = Vec::new();
        // about stream 0 (coded from 1), no chapter, whole time, one field of type text
        for value in [1, 0, 0, 0, 1] {
            push_v(&mut info, value);
        }
        push_text(&mut info, "r_frame_rate");
        // -1, "UTF-8", as a signed number
        push_v(&mut info, 2);
        push_text(&mut info, &format!("{num}/{den}"));
        write_packet(output, INFO, info)?;
    }
    Ok(())
}

/// Writes the head of a frame of `size` bytes at the time stamp `pts`; the content follows.
pub(super) fn write_head(output: &mut impl Write, pts: u64, size: u64) -> io::Result<()> {
    let mut sync = Vec::new();
    push_v(&mut sync, pts);
    push_v(&mut sync, 0);
    write_packet(output, SYNCPOINT, sync)?;
    let mut head = vec![0];
    let flags = flag::KEY | flag::CODED_PTS | flag::SIZE_MSB | flag::CHECKSUM;
    push_v(&mut head, flags | flag::CODED);
    push_v(&mut head, pts + (1 << PTS_BITS));
    push_v(&mut head, size);
    head.extend(checksum(&head).to_be_bytes());
    output.write_all(&head)
}

fn write_packet(output: &mut impl Write, code: u64, mut content: Vec<u8>) -> io::Result<()> {
    content.extend(checksum(&content).to_be_bytes());
    let mut packet = code.to_be_bytes().to_vec();
    // the headers above have less than 4096 bytes, beyond which there is a second checksum
    push_v(&mut packet, content.len() as u64);
    packet.extend(content);
    output.write_all(&packet)
}

fn push_v(bytes: &mut Vec<u8>, value: u64) {
    let groups = (64 - value.leading_zeros()).div_ceil(7).max(1);
    for group in (0..groups).rev() {
        let more = if group > 0 { 128 } else { 0 };
        bytes.push((value >> (7 * group)) as u8 & 127 | more);
    }
}

fn push_text(bytes: &mut Vec<u8>, text: &str) {
    push_v(bytes, text.len() as u64);
    bytes.extend(text.bytes());
}

/// CRC-32 with the polynomial 04C11DB7, first bit first, from zero.
fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = 0u32;
    for byte in bytes {
        crc ^= u32::from(*byte) << 24;
        for _ in 0..8 {
            let carry = crc >> 31 != 0;
            crc = crc << 1 ^ if carry { 0x04C1_1DB7 } else { 0 };
        }
    }
    crc
}

#[cfg(test)]
#[path = "nut_tests.rs"]
mod tests;
