//! Numbers in bytes of either order.

/// The rest of a file, read from the front. Every size is compared with it before it is used.
#[derive(Clone, Copy)]
pub(super) struct Bytes<'a> {
    pub rest: &'a [u8],
    /// Whether the most significant byte of a number comes first.
    pub big: bool,
}

impl<'a> Bytes<'a> {
    /// Takes the next `count` bytes.
    pub fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let there = self.rest.len();
        let (taken, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or_else(|| format!("{count} bytes are announced, but {there} are present"))?;
        self.rest = rest;
        Ok(taken)
    }

    /// Reads the next four bytes as a number.
    pub fn word(&mut self) -> Result<u32, String> {
        let [bytes]: [[u8; 4]; 1] = self.take(4)?.as_chunks().0.try_into().expect("four bytes are one word");
        Ok(if self.big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }
}

/// The storage type of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Storage {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Storage {
    /// Returns the size of a number in bytes.
    pub fn width(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Returns all numbers in `data`. Integers above 2^53 are rounded.
    pub fn numbers(self, data: &[u8], big: bool) -> Result<Vec<f64>, String> {
        let mut all = Vec::with_capacity(data.len() / self.width());
        self.append(data, big, &mut all)?;
        Ok(all)
    }

    /// Appends all numbers in `data` to `to`.
    pub fn append(self, data: &[u8], big: bool, to: &mut Vec<f64>) -> Result<(), String> {
        match self {
            Self::I8 => each(data, big, to, |x| f64::from(i8::from_le_bytes(x))),
            Self::U8 => each(data, big, to, |x| f64::from(u8::from_le_bytes(x))),
            Self::I16 => each(data, big, to, |x| f64::from(i16::from_le_bytes(x))),
            Self::U16 => each(data, big, to, |x| f64::from(u16::from_le_bytes(x))),
            Self::I32 => each(data, big, to, |x| f64::from(i32::from_le_bytes(x))),
            Self::U32 => each(data, big, to, |x| f64::from(u32::from_le_bytes(x))),
            Self::I64 => each(data, big, to, |x| i64::from_le_bytes(x) as f64),
            Self::U64 => each(data, big, to, |x| u64::from_le_bytes(x) as f64),
            Self::F32 => each(data, big, to, |x| f64::from(f32::from_le_bytes(x))),
            Self::F64 => each(data, big, to, f64::from_le_bytes),
        }
    }
}

/// Appends every N bytes as a number; `number` receives them in little-endian order.
fn each<const N: usize>(data: &[u8], big: bool, to: &mut Vec<f64>, number: fn([u8; N]) -> f64) -> Result<(), String> {
    let (whole, rest) = data.as_chunks::<N>();
    if !rest.is_empty() {
        return Err(format!("{} bytes are not a multiple of {N} bytes", data.len()));
    }
    let ordered = |mut bytes: [u8; N]| {
        if big {
            bytes.reverse();
        }
        number(bytes)
    };
    to.extend(whole.iter().copied().map(ordered));
    Ok(())
}
