//! numpy arrays in and out.
//!
//! ```text
//!  in:   the array's own memory is read while the GIL is released; a frame is copied when its turn comes, never the stack
//!  out:  meshes and outlines move into arrays; masks and frames are read-only views of what Rust holds
//! ```

use super::errors::input;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::Mask;
use carved_offline::picture::uneven_greens;
use carved_offline::silhouettes::View;
use numpy::ndarray::{ArrayView, IxDyn};
use numpy::{Element, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Pixels of a picture: 8 bit, row by row, grey `(height, width)` or colour `(height, width, 3)`.
pub type Pixels<'py> = PyReadonlyArrayDyn<'py, u8>;

/// Pixels that may be read without the GIL.
#[derive(Clone, Copy)]
pub struct Picture<'a> {
    width: usize,
    height: usize,
    format: PixelFormat,
    bytes: &'a [u8],
}

impl<'a> Picture<'a> {
    /// The pixels of an array. `bayer`: grey ones are a mosaic whose first four pixels are these, row by row.
    pub fn of(pixels: &'a Pixels<'_>, bayer: Option<&str>) -> PyResult<Self> {
        let (height, width, format) = match *pixels.shape() {
            [height, width] => (height, width, bayer.map_or(Ok(PixelFormat::Mono8), mosaic)?),
            [height, width, 3] => (height, width, PixelFormat::RGB8Packed),
            ref other => return Err(input(format!("a picture has the shape (height, width) or (height, width, 3), found {other:?}"))),
        };
        let bytes = pixels.as_slice().map_err(input)?;
        if let Some(uneven) = uneven_greens(bytes, width, format) {
            return Err(input(format!("bayer: {uneven}; give the order of the camera, for example bayer='grbg'")));
        }
        Ok(Self { width, height, format, bytes })
    }

    /// The frame, with a copy of the pixels.
    pub fn frame(&self) -> Result<RawFrame, carved_core::frame::WrongFrameSize> {
        RawFrame::new(self.width as u32, self.height as u32, self.format, self.bytes.to_vec())
    }

    /// The silhouette, with a copy of the pixels.
    pub fn view(&self, name: &str) -> Result<View, carved_core::profile::WrongMaskSize> {
        View::from_coverage(name.to_owned(), self.width, self.height, self.bytes)
    }

    pub fn grey(&self) -> Option<(&'a [u8], usize)> {
        (self.format == PixelFormat::Mono8).then_some((self.bytes, self.width))
    }
}

fn mosaic(order: &str) -> PyResult<PixelFormat> {
    let orders = || PixelFormat::ALL.into_iter().filter_map(PixelFormat::mosaic).collect::<Vec<_>>().join(", ");
    PixelFormat::of_mosaic(order).ok_or_else(|| input(format!("bayer: found {order:?}, expected one of {}", orders())))
}

/// Rows of an array with `N` columns, without a copy.
pub fn rows<T: Element, const N: usize>(py: Python<'_>, rows: Vec<[T; N]>) -> PyResult<Py<PyArray2<T>>> {
    let count = rows.len();
    Ok(PyArray1::from_vec(py, rows.into_flattened()).reshape([count, N])?.unbind())
}

/// Memory of Rust that arrays show. It never changes, and it lives as long as one of them.
#[pyclass(frozen)]
pub struct Held(Memory);

/// What is held.
pub enum Memory {
    Frame(RawFrame),
    Mask(Mask),
}

/// A read-only array of this memory, without a copy.
pub fn view(py: Python<'_>, memory: Memory) -> PyResult<Py<PyArrayDyn<u8>>> {
    let held = Bound::new(py, Held(memory))?;
    let (shape, bytes) = match &held.get().0 {
        Memory::Frame(frame) => {
            let mut shape = vec![frame.height() as usize, frame.width() as usize];
            shape.extend((frame.format() == PixelFormat::RGB8Packed).then_some(3));
            (shape, frame.bytes())
        }
        Memory::Mask(mask) => (vec![mask.height(), mask.width()], mask.data()),
    };
    let pixels = ArrayView::from_shape(IxDyn(&shape), bytes).map_err(input)?;
    // SAFETY: the array keeps `held` alive. A frozen class gives out no mutable reference, so that the bytes stay where and as they are,
    // and the array itself becomes read-only before anybody sees it.
    #[allow(unsafe_code, reason = "numpy knows no other way to show memory that it does not own")]
    let array = unsafe { PyArrayDyn::borrow_from_array(&pixels, held.clone().into_any()) };
    array.try_readwrite().map_err(input)?.make_nonwriteable();
    Ok(array.unbind())
}
