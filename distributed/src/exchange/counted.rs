//! How much ranks have to say to each other.

use super::Exchange;
use core::fmt;
use std::cell::Cell;

/// What a rank had to do with others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Volume {
    /// Bytes sent to other ranks in swaps.
    pub sent: u64,
    /// Messages in swaps: other ranks that were sent anything.
    pub messages: u64,
    /// Bytes received from other ranks where all give something to all, and in sums.
    pub replicated: u64,
    /// How often all ranks waited for each other.
    pub meetings: u64,
}

/// An exchange that counts.
///
/// ```
/// use mbkd_distributed::{Counted, Exchange, Threads};
/// let sent = Threads::run(2, |ranks| {
///     let ranks = Counted::new(ranks);
///     ranks.swap_bytes(&[b"to rank 0", b"1"]);
///     ranks.volume().sent
/// });
/// assert_eq!(sent, [1, 9], "what stays on a rank does not count");
/// ```
pub struct Counted<'a, E> {
    exchange: &'a E,
    volume: Cell<Volume>,
}

impl<E> fmt::Debug for Counted<'_, E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Counted").field("volume", &self.volume).finish_non_exhaustive()
    }
}

impl<'a, E: Exchange> Counted<'a, E> {
    /// Counts what is exchanged from now on.
    pub fn new(exchange: &'a E) -> Counted<'a, E> {
        Counted { exchange, volume: Cell::default() }
    }

    /// What has been exchanged so far.
    pub fn volume(&self) -> Volume {
        self.volume.get()
    }

    fn count(&self, sent: u64, messages: u64, replicated: u64) {
        let so_far = self.volume.get();
        self.volume.set(Volume {
            sent: so_far.sent + sent,
            messages: so_far.messages + messages,
            replicated: so_far.replicated + replicated,
            meetings: so_far.meetings + 1,
        });
    }
}

impl<E: Exchange> Exchange for Counted<'_, E> {
    fn rank(&self) -> usize {
        self.exchange.rank()
    }

    fn size(&self) -> usize {
        self.exchange.size()
    }

    fn swap_bytes(&self, parts: &[&[u8]]) -> Vec<Vec<u8>> {
        let lengths = (0..).zip(parts).filter(|(to, part)| *to != self.rank() && !part.is_empty());
        let (sent, messages) = lengths.fold((0, 0), |(sent, messages), (_, part)| (sent + part.len(), messages + 1));
        self.count(sent as u64, messages, 0);
        self.exchange.swap_bytes(parts)
    }

    fn gather_bytes(&self, own: &[u8]) -> Vec<Vec<u8>> {
        let all = self.exchange.gather_bytes(own);
        self.count(0, 0, all.iter().map(|part| part.len() as u64).sum::<u64>() - own.len() as u64);
        all
    }

    fn sum(&self, numbers: &mut [u64]) {
        self.count(0, 0, if self.size() > 1 { size_of_val(numbers) as u64 } else { 0 });
        self.exchange.sum(numbers);
    }
}
