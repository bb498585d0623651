//! S3 and what speaks its protocol. The environment variables are those of Amazon's own tools.

use carved_store::{Objects, StoreError};
use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey};
use object_store::path::Path;
use object_store::{BackoffConfig, ClientOptions, Error, ObjectStoreExt, RetryConfig};
use std::time::Duration;
use tokio::runtime::Runtime;

/// Time after which a request without an answer is an error.
const TIMEOUT: Duration = Duration::from_secs(120);
const RETRIES: usize = 3;

/// One bucket.
pub struct Bucket {
    /// `s3://BUCKET/`
    root: String,
    store: AmazonS3,
    runtime: Runtime,
}

impl Bucket {
    /// Opens the bucket of an address. Nothing is sent yet.
    ///
    /// # Errors
    /// The address names no bucket, or the environment has a setting that cannot be used.
    pub fn of(address: &str) -> Result<Self, StoreError> {
        let remote = |why: String| StoreError::Remote { address: address.to_owned(), why };
        let name = address.strip_prefix("s3://").and_then(|rest| rest.split('/').next()).filter(|name| !name.is_empty());
        let name = name.ok_or_else(|| remote("the address names no bucket; expected s3://BUCKET/PREFIX".into()))?;
        // Another part of the program may have chosen already.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let retry = RetryConfig { backoff: BackoffConfig::default(), max_retries: RETRIES, retry_timeout: TIMEOUT };
        let mut builder = AmazonS3Builder::from_env().with_bucket_name(name).with_retry(retry);
        // A server of one's own, named on purpose, may speak plain HTTP.
        let is_plain = builder.get_config_value(&AmazonS3ConfigKey::Endpoint).is_some_and(|endpoint| endpoint.starts_with("http://"));
        builder = builder.with_client_options(ClientOptions::new().with_allow_http(is_plain).with_timeout(TIMEOUT));
        let root = format!("s3://{name}/");
        let store = builder.build().map_err(|error| failed(&root, address, &error))?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(|error| remote(error.to_string()))?;
        Ok(Self { root, store, runtime })
    }

    fn key(&self, address: &str) -> Result<Path, StoreError> {
        let key = address.strip_prefix(&self.root).unwrap_or(address);
        Path::parse(key).map_err(|error| StoreError::Remote { address: address.to_owned(), why: error.to_string() })
    }
}

impl Objects for Bucket {
    fn get(&self, address: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let key = self.key(address)?;
        let found = self.runtime.block_on(async { self.store.get(&key).await?.bytes().await });
        match found {
            Ok(bytes) => Ok(Some(bytes.into())),
            // The same code says that there is no bucket.
            Err(error @ Error::NotFound { .. }) if !error.to_string().contains("NoSuchBucket") => Ok(None),
            Err(error) => Err(failed(&self.root, address, &error)),
        }
    }

    fn put(&self, address: &str, bytes: Vec<u8>) -> Result<(), StoreError> {
        let key = self.key(address)?;
        self.runtime.block_on(self.store.put(&key, bytes.into())).map(|_| ()).map_err(|error| failed(&self.root, address, &error))
    }
}

/// What a failure means, and the way out.
fn failed(root: &str, address: &str, error: &Error) -> StoreError {
    let mut why = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(inner) = cause {
        let said = inner.to_string();
        if !why.contains(&said) {
            why = format!("{why}: {said}");
        }
        cause = inner.source();
    }
    let bucket = root.trim_end_matches('/');
    let no_key = std::env::var_os("AWS_ACCESS_KEY_ID").is_none();
    let way_out = match error {
        Error::Unauthenticated { .. } | Error::PermissionDenied { .. } => {
            format!("the store refuses these credentials; look at AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and the rights on {bucket}")
        }
        _ if why.contains("NoSuchBucket") => {
            format!("there is no bucket {bucket}; create it first, or look at AWS_REGION and AWS_ENDPOINT_URL")
        }
        _ if no_key => "there are no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY".to_owned(),
        _ => "the store cannot be reached; look at the network, AWS_ENDPOINT_URL and AWS_REGION, and start the command again: it goes on"
            .into(),
    };
    StoreError::Remote { address: address.to_owned(), why: format!("{way_out} ({why})") }
}
