//! Ranks that are threads of one process.

use super::Exchange;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

/// Ranks that are threads of one process.
///
/// ```
/// use mbkd_distributed::{Exchange, Threads};
/// let sums = Threads::run(3, |ranks| {
///     let mut number = [ranks.rank() as u64];
///     ranks.sum(&mut number);
///     number[0]
/// });
/// assert_eq!(sums, [3, 3, 3]);
/// ```
#[derive(Debug)]
pub struct Threads {
    rank: usize,
    to: Vec<Sender<Vec<u8>>>,
    from: Vec<Receiver<Vec<u8>>>,
}

impl Threads {
    /// Runs `body` on `size` ranks; returns what each of them returned. Panics where one of them does.
    pub fn run<R: Send>(size: usize, body: impl Fn(&Threads) -> R + Sync) -> Vec<R> {
        let mut ranks: Vec<Threads> = (0..size).map(|rank| Threads { rank, to: vec![], from: vec![] }).collect();
        for from in 0..size {
            for to in 0..size {
                let (send, receive) = channel();
                ranks[from].to.push(send);
                ranks[to].from.push(receive);
            }
        }
        // Each thread takes its rank along, so that its channels close where it panics, and no other waits for it.
        let body = &body;
        thread::scope(|scope| {
            let threads: Vec<_> = ranks.into_iter().map(|rank| scope.spawn(move || body(&rank))).collect();
            threads.into_iter().map(|thread| thread.join().expect("a rank has panicked")).collect()
        })
    }
}

impl Exchange for Threads {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.to.len()
    }

    fn swap_bytes(&self, parts: &[&[u8]]) -> Vec<Vec<u8>> {
        for (to, part) in self.to.iter().zip(parts) {
            to.send(part.to_vec()).expect("a rank has panicked");
        }
        self.from.iter().map(|from| from.recv().expect("a rank has panicked")).collect()
    }

    fn gather_bytes(&self, own: &[u8]) -> Vec<Vec<u8>> {
        self.swap_bytes(&vec![own; self.size()])
    }

    fn sum(&self, numbers: &mut [u64]) {
        let all = super::gather(self, numbers);
        numbers.fill(0);
        for (sum, number) in all.iter().flat_map(|theirs| (0..).zip(theirs)) {
            let sum: usize = sum;
            numbers[sum] += number;
        }
    }
}
