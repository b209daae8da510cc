//! Chunks of arrays from another package's memory: the only unsafe code of this crate.
//!
//! That pointers and lengths are right is the producer's promise by Arrow's C interfaces, which no
//! reader can check. What they point to (offsets, UTF-8, alignment) is checked before it is read.

use std::ffi::CStr;

use arrow_array::ffi::{FFI_ArrowArray, FFI_ArrowSchema, from_ffi_and_data_type};
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{ArrayRef, make_array};
use arrow_schema::{DataType, Field};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::error::invalid;

/// Type of a column or a table, and its arrays.
pub(super) struct Chunks {
    pub(super) data_type: DataType,
    pub(super) arrays: Vec<ArrayRef>,
}

/// Takes the arrays of an object.
pub(super) fn chunks(data: &Bound<'_, PyAny>) -> PyResult<Chunks> {
    if data.hasattr("__arrow_c_stream__")? {
        let capsule = data.call_method0("__arrow_c_stream__")?.cast_into::<PyCapsule>();
        return from_stream(&capsule.map_err(|_| invalid("__arrow_c_stream__ is not a capsule"))?);
    }
    if data.hasattr("__arrow_c_array__")? {
        let pair: Result<(Bound<'_, PyCapsule>, Bound<'_, PyCapsule>), _> =
            data.call_method0("__arrow_c_array__")?.extract();
        let (schema, array) =
            pair.map_err(|_| invalid("__arrow_c_array__ is not a pair of capsules"))?;
        return from_array(&schema, &array);
    }
    let name = data.get_type().name()?;
    Err(invalid(format!("a {name} has neither __arrow_c_stream__ nor __arrow_c_array__")))
}

fn type_of(schema: &FFI_ArrowSchema) -> PyResult<DataType> {
    Ok(Field::try_from(schema).map_err(invalid)?.data_type().clone())
}

/// Takes ownership of an array, whose release callback keeps its memory, and checks its contents.
fn checked(array: FFI_ArrowArray, data_type: &DataType) -> PyResult<ArrayRef> {
    // SAFETY: the producer promises by the C data interface that the array has the layout of the
    // schema that came with it, and `data_type` was read from that schema.
    #[expect(unsafe_code, reason = "memory of another package")]
    let mut data = unsafe { from_ffi_and_data_type(array, data_type.clone()) }.map_err(invalid)?;
    // Producers need not align their data, but readers of typed values need it aligned.
    data.align_buffers();
    data.validate_full().map_err(invalid)?;
    Ok(make_array(data))
}

fn from_array(schema: &Bound<'_, PyCapsule>, array: &Bound<'_, PyCapsule>) -> PyResult<Chunks> {
    let schema = schema.pointer_checked(Some(c"arrow_schema")).map_err(invalid)?;
    let array = array.pointer_checked(Some(c"arrow_array")).map_err(invalid)?;
    // SAFETY: by the interface, capsules of these names hold these structs, and `pointer_checked`
    // compared the names. Both are moved out, which marks them released in the capsules, so that
    // nothing is released twice.
    #[expect(unsafe_code, reason = "memory of another package")]
    let (schema, array) = unsafe {
        (
            FFI_ArrowSchema::from_raw(schema.cast().as_ptr()),
            FFI_ArrowArray::from_raw(array.cast().as_ptr()),
        )
    };
    // A second consumer of one capsule finds a released array.
    if array.is_released() {
        return Err(invalid("the arrow array was taken before"));
    }
    let data_type = type_of(&schema)?;
    let arrays = vec![checked(array, &data_type)?];
    Ok(Chunks { data_type, arrays })
}

fn from_stream(capsule: &Bound<'_, PyCapsule>) -> PyResult<Chunks> {
    let pointer = capsule.pointer_checked(Some(c"arrow_array_stream")).map_err(invalid)?;
    // SAFETY: by the interface, a capsule of this name holds this struct, and `pointer_checked`
    // compared the name. It is moved out, which marks it released in the capsule.
    #[expect(unsafe_code, reason = "memory of another package")]
    let mut stream = unsafe { FFI_ArrowArrayStream::from_raw(pointer.cast().as_ptr()) };
    let (Some(get_schema), Some(get_next)) = (stream.get_schema, stream.get_next) else {
        return Err(invalid("the arrow stream was taken before"));
    };
    let mut schema = FFI_ArrowSchema::empty();
    // SAFETY: the stream is not released, since it has its callbacks, and `schema` is a valid place
    // to write to.
    #[expect(unsafe_code, reason = "memory of another package")]
    let code = unsafe { get_schema(&raw mut stream, &raw mut schema) };
    check(&mut stream, code)?;
    let data_type = type_of(&schema)?;
    let mut arrays = Vec::new();
    loop {
        let mut array = FFI_ArrowArray::empty();
        // SAFETY: as for `get_schema`, with `array` as the place.
        #[expect(unsafe_code, reason = "memory of another package")]
        let code = unsafe { get_next(&raw mut stream, &raw mut array) };
        check(&mut stream, code)?;
        // The stream ends with a released array.
        if array.is_released() {
            return Ok(Chunks { data_type, arrays });
        }
        arrays.push(checked(array, &data_type)?);
    }
}

/// Returns an error if a callback of the stream returned a code other than 0.
fn check(stream: &mut FFI_ArrowArrayStream, code: i32) -> PyResult<()> {
    if code == 0 {
        return Ok(());
    }
    let mut text = format!("error {code}");
    if let Some(last) = stream.get_last_error {
        // SAFETY: the stream is not released. Its text ends in a zero byte and is valid until the
        // next call of a callback; it is copied before.
        #[expect(unsafe_code, reason = "memory of another package")]
        unsafe {
            let found = last(std::ptr::from_mut(stream));
            if !found.is_null() {
                text = CStr::from_ptr(found).to_string_lossy().into_owned();
            }
        }
    }
    Err(invalid(format!("the arrow stream failed: {text}")))
}
