//! Whether the pixels of a JPEG are whole. A decoder fills up what is missing, and says nothing of it.
//!
//! ```text
//! tables, frame ── scan ── up to each restart: one code after another, block by block ─┐
//!                   ▲                                                                  ├─ ends within its last byte?
//!                   └───────────────── next scan ◄─────────────────────────────────────┘
//! end marker: does every coefficient of every colour have its last bit?
//! ```
//! No picture is computed: codes are counted. Where blocks are missing, the codes end before or after their bytes. A change of a few bytes
//! within one block can go unnoticed, and costs that block only.

use super::{DecodeError, MOST_ALLOCATED};
use image::ImageFormat;

/// A progressive picture has about ten.
const MOST_SCANS: usize = 200;
const COEFFICIENTS: usize = 64;

/// Checks everything up to the marker of the end.
///
/// # Errors
/// Codes that are missing, left over or impossible, and kinds of JPEG whose codes are not known.
pub(super) fn check(bytes: &[u8]) -> Result<(), DecodeError> {
    Reader::default().check(bytes)
}

fn incomplete(why: impl Into<String>) -> DecodeError {
    DecodeError::Incomplete { format: ImageFormat::Jpeg, why: why.into() }
}

fn headless() -> DecodeError {
    incomplete("it ends within a header, or the header is damaged")
}

/// A Huffman table.
#[derive(Clone)]
struct Codes {
    /// Number of codes of each length, from 1 bit.
    counts: [u16; 16],
    values: Vec<u8>,
}

/// The codes up to a restart, without what is stuffed between them.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    left: u8,
}

/// No more bits, or no such code.
enum Break {
    Ended,
    Impossible,
}

impl Bits<'_> {
    fn bit(&mut self) -> Result<u32, Break> {
        if self.left == 0 {
            // A stuffed zero follows each 0xff.
            self.at += self.stuffed();
            if self.at >= self.bytes.len() {
                return Err(Break::Ended);
            }
            self.at += 1;
            self.left = 8;
        }
        self.left -= 1;
        Ok(u32::from((self.bytes[self.at - 1] >> self.left) & 1))
    }

    fn bits(&mut self, count: u8) -> Result<u32, Break> {
        (0..count).try_fold(0, |value, _| Ok(value << 1 | self.bit()?))
    }

    fn code(&mut self, codes: &Codes) -> Result<u8, Break> {
        let (mut code, mut first, mut index) = (0u32, 0u32, 0u32);
        for count in codes.counts.map(u32::from) {
            code |= self.bit()?;
            if code < first + count {
                return codes.values.get((index + code - first) as usize).copied().ok_or(Break::Impossible);
            }
            index += count;
            first = (first + count) << 1;
            code <<= 1;
        }
        Err(Break::Impossible)
    }

    /// Whole bytes that no code has used.
    fn unused(&self) -> usize {
        self.bytes.len().saturating_sub(self.at + self.stuffed())
    }

    fn stuffed(&self) -> usize {
        usize::from(self.at > 0 && self.bytes.get(self.at - 1) == Some(&0xff))
    }
}

/// One colour of the picture.
struct Component {
    id: u8,
    /// Blocks of one unit of all colours, across and down.
    unit: (usize, usize),
    /// Blocks of the picture, across and down, and of the full units across.
    blocks: (usize, usize),
    stride: usize,
    /// Which coefficients of each block are known not to be zero. Only progressive pictures need it.
    seen: Vec<u64>,
    /// The lowest bit that is known of each coefficient. `None`: nothing is known.
    lowest: [Option<u8>; COEFFICIENTS],
}

struct Frame {
    is_progressive: bool,
    /// Units across and down.
    units: (usize, usize),
    components: Vec<Component>,
}

/// What a scan brings: coefficients `first..=last`, down to bit `low`, after bit `high` was known.
#[derive(Clone, Copy)]
struct Band {
    first: usize,
    last: usize,
    high: u8,
    low: u8,
}

/// A colour of a scan and its tables.
struct Part<'a> {
    component: usize,
    dc: Option<&'a Codes>,
    ac: Option<&'a Codes>,
}

#[derive(Default)]
struct Reader {
    dc: [Option<Codes>; 4],
    ac: [Option<Codes>; 4],
    /// Units between two restarts. 0: no restarts.
    restart: usize,
    frame: Option<Frame>,
}

impl Reader {
    fn check(mut self, bytes: &[u8]) -> Result<(), DecodeError> {
        const END: u8 = 0xd9;
        let (mut at, mut scans) = (2, 0);
        loop {
            let Some(&[mark, marker]) = bytes.get(at..at + 2) else {
                return Err(incomplete("the marker of its end is missing"));
            };
            match (mark, marker) {
                (0xff, 0xff) => at += 1,
                (0xff, END) => return self.check_final(),
                (0xff, 0x01 | 0xd0..=0xd8) => at += 2,
                (0xff, 0x02..) => {
                    let length = bytes.get(at + 2..at + 4).map_or(0, |l| usize::from(u16::from_be_bytes([l[0], l[1]])));
                    let segment = bytes.get(at + 4..at + 2 + length.max(2)).filter(|_| length >= 2).ok_or_else(headless)?;
                    at += 2 + length;
                    match marker {
                        0xc4 => self.tables(segment)?,
                        0xc0..=0xc2 => self.frame = Some(frame(segment, marker == 0xc2)?),
                        0xc3 | 0xc5..=0xcf => {
                            return Err(DecodeError::Kind {
                                why: format!("a JPEG of kind SOF{} (lossless, hierarchical or arithmetic)", marker - 0xc0),
                            });
                        }
                        0xdd => self.restart = segment.get(..2).map_or(0, |r| usize::from(u16::from_be_bytes([r[0], r[1]]))),
                        0xda => {
                            scans += 1;
                            if scans > MOST_SCANS {
                                return Err(incomplete(format!("it has more than {MOST_SCANS} scans")));
                            }
                            let codes = codes_from(&bytes[at..]);
                            self.scan(segment, codes)?;
                            at += codes.len();
                        }
                        _ => (),
                    }
                }
                _ => return Err(incomplete("bytes stand between its segments")),
            }
        }
    }

    fn tables(&mut self, mut segment: &[u8]) -> Result<(), DecodeError> {
        while let Some((&head, rest)) = segment.split_first() {
            let lengths = rest.get(..16).ok_or_else(headless)?;
            let mut counts = [0; 16];
            counts.iter_mut().zip(lengths).for_each(|(count, length)| *count = u16::from(*length));
            let number = counts.iter().map(|count| usize::from(*count)).sum();
            let values = rest[16..].get(..number).ok_or_else(headless)?.to_vec();
            segment = &rest[16 + number..];
            let place = if head >> 4 == 0 { &mut self.dc } else { &mut self.ac };
            *place.get_mut(usize::from(head & 15)).ok_or_else(headless)? = Some(Codes { counts, values });
        }
        Ok(())
    }

    fn check_final(&self) -> Result<(), DecodeError> {
        let frame = self.frame.as_ref().ok_or_else(|| incomplete("it ends before its picture"))?;
        let is_whole = frame.components.iter().all(|component| component.lowest.iter().all(|low| *low == Some(0)));
        if is_whole { Ok(()) } else { Err(incomplete("its last scans are missing")) }
    }

    fn scan(&mut self, segment: &[u8], codes: &[u8]) -> Result<(), DecodeError> {
        let frame = self.frame.as_mut().ok_or_else(headless)?;
        let number = usize::from(*segment.first().ok_or_else(headless)?);
        let [first, last, bits] = *segment.get(1 + 2 * number..4 + 2 * number).ok_or_else(headless)? else { return Err(headless()) };
        let mut band = Band { first: first.into(), last: last.into(), high: bits >> 4, low: bits & 15 };
        if !frame.is_progressive {
            band = Band { first: 0, last: COEFFICIENTS - 1, high: 0, low: 0 };
        }
        let is_mixed = band.first == 0 && band.last > 0 && frame.is_progressive;
        if number == 0 || band.first > band.last || band.last >= COEFFICIENTS || is_mixed || (band.first > 0 && number > 1) {
            return Err(headless());
        }
        let mut parts = Vec::new();
        for named in segment[1..=2 * number].chunks_exact(2) {
            let component = frame.components.iter().position(|component| component.id == named[0]).ok_or_else(headless)?;
            let table = |tables: &'_ [Option<Codes>; 4], at: u8| tables.get(usize::from(at)).cloned().flatten();
            parts.push((component, table(&self.dc, named[1] >> 4), table(&self.ac, named[1] & 15)));
        }
        let parts: Vec<Part> =
            parts.iter().map(|(component, dc, ac)| Part { component: *component, dc: dc.as_ref(), ac: ac.as_ref() }).collect();
        for part in &parts {
            frame.components[part.component].lowest[band.first..=band.last].fill(Some(band.low));
        }
        let units = match &parts[..] {
            [part] => frame.components[part.component].blocks,
            _ => frame.units,
        };
        let units = units.0 * units.1;
        let step = if self.restart == 0 { units } else { self.restart };
        let intervals = intervals(codes);
        let mut done = 0;
        for interval in &intervals {
            let end = units.min(done + step);
            let mut bits = Bits { bytes: interval, at: 0, left: 0 };
            let mut run = 0;
            for unit in done..end {
                let read = frame.unit(&parts, unit, band, &mut bits, &mut run);
                read.map_err(|broken| {
                    let percent = 100 * unit / units;
                    incomplete(match broken {
                        Break::Ended => format!("its pixels end at {percent} % of the picture"),
                        Break::Impossible => format!("its pixels are damaged before {percent} % of the picture"),
                    })
                })?;
            }
            // Some cameras end the last unit with a restart too.
            if run > 0 || bits.unused() > 0 || (end == done && !interval.is_empty()) {
                return Err(incomplete("its pixels are damaged: they do not end where their bytes end"));
            }
            done = end;
        }
        if done < units {
            return Err(incomplete(format!("its pixels end at {} % of the picture", 100 * done / units)));
        }
        Ok(())
    }
}

fn frame(segment: &[u8], is_progressive: bool) -> Result<Frame, DecodeError> {
    let [_, high, low, wide, narrow, number] = *segment.get(..6).ok_or_else(headless)? else { return Err(headless()) };
    let (height, width) = (usize::from(u16::from_be_bytes([high, low])), usize::from(u16::from_be_bytes([wide, narrow])));
    let named = segment.get(6..6 + 3 * usize::from(number)).ok_or_else(headless)?;
    let sampling = || named.chunks_exact(3).map(|named| (usize::from(named[1] >> 4), usize::from(named[1] & 15)));
    let most = sampling().fold((0, 0), |most, (h, v)| (most.0.max(h), most.1.max(v)));
    if height == 0 || width == 0 || number == 0 || sampling().any(|(h, v)| !(1..=4).contains(&h) || !(1..=4).contains(&v)) {
        return Err(headless());
    }
    let units = (width.div_ceil(8 * most.0), height.div_ceil(8 * most.1));
    if (units.0 * units.1 * most.0 * most.1 * usize::from(number) * 8) as u64 > MOST_ALLOCATED {
        return Err(incomplete(format!("its header says {width} x {height} px, too large to be decoded")));
    }
    let component = |named: &[u8], (h, v): (usize, usize)| Component {
        id: named[0],
        unit: (h, v),
        blocks: ((width * h).div_ceil(most.0).div_ceil(8), (height * v).div_ceil(most.1).div_ceil(8)),
        stride: units.0 * h,
        seen: vec![0; if is_progressive { units.0 * h * units.1 * v } else { 0 }],
        lowest: [None; COEFFICIENTS],
    };
    let components = named.chunks_exact(3).zip(sampling()).map(|(named, sampling)| component(named, sampling)).collect();
    Ok(Frame { is_progressive, units, components })
}

impl Frame {
    /// Reads the codes of one unit: one block of the only colour, or the blocks of all.
    fn unit(&mut self, parts: &[Part], unit: usize, band: Band, bits: &mut Bits, run: &mut u32) -> Result<(), Break> {
        if let [part] = parts {
            let component = &mut self.components[part.component];
            let (u, v) = (unit % component.blocks.0, unit / component.blocks.0);
            return self.block(part, v * self.components[part.component].stride + u, band, bits, run);
        }
        let (across, down) = (unit % self.units.0, unit / self.units.0);
        for part in parts {
            let Component { unit: (h, v), stride, .. } = self.components[part.component];
            for at in 0..h * v {
                self.block(part, (down * v + at / h) * stride + across * h + at % h, band, bits, run)?;
            }
        }
        Ok(())
    }

    fn block(&mut self, part: &Part, block: usize, band: Band, bits: &mut Bits, run: &mut u32) -> Result<(), Break> {
        let mut at = band.first;
        if at == 0 {
            if band.high > 0 {
                bits.bit()?;
            } else {
                let size = bits.code(part.dc.ok_or(Break::Impossible)?)?;
                bits.bits(size.min(16))?;
            }
            at = 1;
        }
        if band.last == 0 {
            return Ok(());
        }
        let codes = part.ac.ok_or(Break::Impossible)?;
        if !self.is_progressive {
            return sequential(codes, bits);
        }
        let seen = self.components[part.component].seen.get_mut(block).ok_or(Break::Impossible)?;
        if band.high > 0 { refined(seen, at, band.last, codes, bits, run) } else { begun(seen, at, band.last, codes, bits, run) }
    }
}

fn sequential(codes: &Codes, bits: &mut Bits) -> Result<(), Break> {
    let mut at = 1;
    while at < COEFFICIENTS {
        let code = bits.code(codes)?;
        let (zeros, size) = (usize::from(code >> 4), code & 15);
        match (zeros, size) {
            (15, 0) => at += 16,
            (_, 0) => return Ok(()),
            _ => {
                at += zeros;
                if at >= COEFFICIENTS {
                    return Err(Break::Impossible);
                }
                bits.bits(size)?;
                at += 1;
            }
        }
    }
    Ok(())
}

/// The first bits of the coefficients of a block. `run`: so many blocks have none.
fn begun(seen: &mut u64, first: usize, last: usize, codes: &Codes, bits: &mut Bits, run: &mut u32) -> Result<(), Break> {
    if *run > 0 {
        *run -= 1;
        return Ok(());
    }
    let mut at = first;
    while at <= last {
        let code = bits.code(codes)?;
        let (zeros, size) = (code >> 4, code & 15);
        if size == 0 && zeros < 15 {
            *run = (1 << zeros) - 1 + bits.bits(zeros)?;
            return Ok(());
        }
        at += usize::from(zeros);
        if size > 0 {
            if at > last {
                return Err(Break::Impossible);
            }
            bits.bits(size)?;
            *seen |= 1 << at;
        }
        at += 1;
    }
    Ok(())
}

/// One more bit of the coefficients of a block.
fn refined(seen: &mut u64, first: usize, last: usize, codes: &Codes, bits: &mut Bits, run: &mut u32) -> Result<(), Break> {
    let mut at = first;
    if *run == 0 {
        while at <= last {
            let code = bits.code(codes)?;
            let (mut zeros, size) = (code >> 4, code & 15);
            if size == 0 && zeros < 15 {
                *run = (1 << zeros) + bits.bits(zeros)?;
                break;
            }
            bits.bits(size)?;
            while at <= last {
                if *seen >> at & 1 == 1 {
                    bits.bit()?;
                } else if zeros == 0 {
                    break;
                } else {
                    zeros -= 1;
                }
                at += 1;
            }
            if size > 0 {
                if at > last {
                    return Err(Break::Impossible);
                }
                *seen |= 1 << at;
            }
            at += 1;
        }
    }
    if *run > 0 {
        for at in at..=last {
            if *seen >> at & 1 == 1 {
                bits.bit()?;
            }
        }
        *run -= 1;
    }
    Ok(())
}

/// The codes of a scan with their restarts: up to the next other marker.
fn codes_from(bytes: &[u8]) -> &[u8] {
    let is_other = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xff | 0xd0..=0xd7);
    &bytes[..bytes.windows(2).position(is_other).unwrap_or(bytes.len())]
}

/// The codes between two restarts, without the bytes that fill up before a marker.
fn intervals(codes: &[u8]) -> Vec<&[u8]> {
    let is_restart = |at: usize| codes[at] == 0xff && codes.get(at + 1).is_some_and(|marker| (0xd0..=0xd7).contains(marker));
    let (mut all, mut begin) = (Vec::new(), 0);
    for at in (0..codes.len()).filter(|at| is_restart(*at)) {
        all.push(&codes[begin..at]);
        begin = at + 2;
    }
    all.push(&codes[begin..]);
    let unfilled = |interval: &'_ [u8]| interval.iter().rposition(|byte| *byte != 0xff).map_or(0, |last| last + 1);
    all.into_iter().map(|interval| &interval[..unfilled(interval)]).collect()
}
