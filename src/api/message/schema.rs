//! Schemas of the enums that the contract writes by name.

use serde::{Serialize, Serializer};
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use utoipa::openapi::{RefOr, schema};
use utoipa::{PartialSchema, ToSchema};

use super::request::View;
use super::strict::{Named, write_name};
use crate::service::StopReason;
use crate::service::domain::{
    ContactMethod, ContactMode, ContactName, LowerBoundAssumption, Method, ReferencePoint, RefinementOutcome, Status,
};

fn names<T: Named>() -> RefOr<Schema> {
    let names = T::ALL.iter().map(|value| value.name());
    let object = ObjectBuilder::new().schema_type(schema::SchemaType::Type(Type::String)).enum_values(Some(names));
    RefOr::T(object.build().into())
}

macro_rules! named_schemas {
    ($($name:ident),*) => {
        $(
            impl PartialSchema for $name {
                fn schema() -> RefOr<Schema> {
                    names::<Self>()
                }
            }

            impl ToSchema for $name {}

            // For the defaults in schemas.
            impl Serialize for $name {
                fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                    write_name(self, serializer)
                }
            }
        )*
    };
}

named_schemas!(
    View,
    ReferencePoint,
    Method,
    ContactMethod,
    Status,
    StopReason,
    ContactMode,
    ContactName,
    RefinementOutcome,
    LowerBoundAssumption
);
