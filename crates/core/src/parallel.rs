//! Iterators that are spread over the processor's cores where the feature `rayon` is on, and run one after the other where it is off.
//!
//! The science calls the methods of `rayon::prelude`. Without the feature the traits below have methods of the same names that give the
//! iterators of the standard library. Results are collected in order and sums are taken in a fixed order, so both ways give the same bytes.

/// Results of both, which may be computed at the same time.
pub(crate) fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    #[cfg(feature = "rayon")]
    return rayon::join(a, b);
    #[cfg(not(feature = "rayon"))]
    (a(), b())
}

pub(crate) mod prelude {
    #[cfg(feature = "rayon")]
    pub(crate) use rayon::prelude::*;

    #[cfg(not(feature = "rayon"))]
    pub(crate) use super::serial::*;
}

#[cfg(not(feature = "rayon"))]
mod serial {
    /// `into_par_iter`.
    pub(crate) trait IntoParallelIterator: IntoIterator + Sized {
        fn into_par_iter(self) -> Self::IntoIter {
            self.into_iter()
        }
    }

    impl<I: IntoIterator> IntoParallelIterator for I {}

    /// `par_iter`, `par_iter_mut`, `par_chunks` and `par_chunks_mut` of slices.
    pub(crate) trait ParallelSlice<T> {
        fn par_iter(&self) -> std::slice::Iter<'_, T>;
        fn par_iter_mut(&mut self) -> std::slice::IterMut<'_, T>;
        fn par_chunks(&self, size: usize) -> std::slice::Chunks<'_, T>;
        fn par_chunks_mut(&mut self, size: usize) -> std::slice::ChunksMut<'_, T>;
    }

    impl<T> ParallelSlice<T> for [T] {
        fn par_iter(&self) -> std::slice::Iter<'_, T> {
            self.iter()
        }

        fn par_iter_mut(&mut self) -> std::slice::IterMut<'_, T> {
            self.iter_mut()
        }

        fn par_chunks(&self, size: usize) -> std::slice::Chunks<'_, T> {
            self.chunks(size)
        }

        fn par_chunks_mut(&mut self, size: usize) -> std::slice::ChunksMut<'_, T> {
            self.chunks_mut(size)
        }
    }

    /// What parallel iterators have and iterators have not.
    pub(crate) trait ParallelIterator: Iterator + Sized {
        fn with_min_len(self, _least: usize) -> Self {
            self
        }

        /// Maps with one working memory, which `init` makes. Rayon makes one per piece of work.
        fn map_init<M, R>(self, init: impl Fn() -> M, of: impl Fn(&mut M, Self::Item) -> R) -> impl Iterator<Item = R> {
            let mut memory = init();
            self.map(move |item| of(&mut memory, item))
        }

        fn flat_map_iter<I: IntoIterator>(self, of: impl Fn(Self::Item) -> I) -> impl Iterator<Item = I::Item> {
            self.flat_map(of)
        }

        fn find_map_first<R>(mut self, of: impl Fn(Self::Item) -> Option<R>) -> Option<R> {
            self.find_map(of)
        }
    }

    impl<I: Iterator> ParallelIterator for I {}

    /// `par_extend`.
    pub(crate) trait ParallelExtend<T>: Extend<T> {
        fn par_extend(&mut self, items: impl Iterator<Item = T>) {
            self.extend(items);
        }
    }

    impl<T> ParallelExtend<T> for Vec<T> {}
}
