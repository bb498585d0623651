//! Copies of runs in an object store, such as S3. What speaks its protocol is given by the caller.

use super::StoreError;

/// The beginning of the address of an object store.
const SCHEME: &str = "s3://";

/// Objects by their address, `s3://BUCKET/KEY`.
pub trait Objects {
    /// The bytes of an object, read from the store now. `None` if there is no object of this address.
    ///
    /// # Errors
    /// The store cannot be reached or refuses.
    fn get(&self, address: &str) -> Result<Option<Vec<u8>>, StoreError>;

    /// Writes an object.
    ///
    /// # Errors
    /// The store cannot be reached or refuses.
    fn put(&self, address: &str, bytes: Vec<u8>) -> Result<(), StoreError>;
}

/// Opens the object store of an address, or says why this program cannot.
pub type Reach<'a> = &'a dyn Fn(&str) -> Result<Box<dyn Objects>, StoreError>;

/// Whether a destination is the address of an object store, not a folder.
pub fn is_address(destination: &str) -> bool {
    destination.starts_with(SCHEME)
}

/// Writes an object unless it is there, or where what is there may be replaced. Reads it back, and verifies what was read.
///
/// # Errors
/// The object is there with other bytes, or reads back differently.
pub(super) fn keep(
    objects: &dyn Objects,
    address: &str,
    bytes: impl FnOnce() -> Result<Vec<u8>, StoreError>,
    verify: impl Fn(Vec<u8>) -> Result<(), StoreError>,
    may_replace: impl Fn(&[u8]) -> Result<bool, StoreError>,
) -> Result<(), StoreError> {
    if let Some(found) = objects.get(address)?
        && !may_replace(&found)?
    {
        return verify(found).map_err(|error| match error {
            StoreError::Altered { .. } | StoreError::Vanished { .. } | StoreError::Format { .. } => {
                StoreError::Exists { path: address.into() }
            }
            error => error,
        });
    }
    objects.put(address, bytes()?)?;
    verify(objects.get(address)?.ok_or_else(|| StoreError::Vanished { path: address.into() })?)
}
