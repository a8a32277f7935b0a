//! Reads CDR as ROS 2 writes it: little-endian, numbers aligned to their size.

/// A message that is read from its begin.
pub(crate) struct Cdr<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> Cdr<'a> {
    pub(crate) fn new(message: &'a [u8]) -> Self {
        assert_eq!(message[..4], [0, 1, 0, 0]);
        Self { bytes: &message[4..], position: 0 }
    }

    fn number<const N: usize>(&mut self) -> [u8; N] {
        self.position = self.position.next_multiple_of(N) + N;
        self.bytes[self.position - N..self.position].try_into().unwrap()
    }

    pub(crate) fn uint32(&mut self) -> u32 {
        u32::from_le_bytes(self.number())
    }

    pub(crate) fn float64s<const N: usize>(&mut self) -> [f64; N] {
        [(); N].map(|()| f64::from_le_bytes(self.number()))
    }

    pub(crate) fn array(&mut self) -> Vec<f64> {
        (0..self.uint32()).map(|_| f64::from_le_bytes(self.number())).collect()
    }

    pub(crate) fn text(&mut self) -> String {
        let length = self.uint32() as usize;
        let text = &self.bytes[self.position..self.position + length];
        self.position += length;
        assert_eq!(text.last(), Some(&0));
        String::from_utf8(text[..length - 1].to_vec()).unwrap()
    }

    /// ns.
    pub(crate) fn time(&mut self) -> u64 {
        u64::from(self.uint32()) * 1_000_000_000 + u64::from(self.uint32())
    }

    /// Stamp and frame.
    pub(crate) fn header(&mut self) -> (u64, String) {
        (self.time(), self.text())
    }

    pub(crate) fn is_at_end(&self) -> bool {
        self.position == self.bytes.len()
    }
}
