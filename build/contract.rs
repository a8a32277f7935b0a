//! Compiles the protobuf files with a compiler written in Rust: the build needs no protoc.
//!
//! Two outputs: `contract/`, the messages, which are JSON too, and `grpc/`, the service over them with the messages of
//! alternatives that only its streams have. The lists below state what JSON needs beside what protobuf says.

#![expect(clippy::wildcard_enum_match_arm, reason = "the other kinds of fields are plain values")]

use std::collections::BTreeSet;
use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::{env, fs};

use protox::prost_reflect::{DescriptorPool, EnumDescriptor, FieldDescriptor, Kind, MessageDescriptor};
use tonic_prost_build::Builder;

const PACKAGE: &str = "slipdrive.v1";
/// Fields of requests that have no default.
const REQUIRED: [&str; 18] = [
    "AssessRequest.tolerances",
    "AssessRequest.uncertain",
    "ExportRequest.format",
    "ExportRequest.rate_hz",
    "Payload.mass_kg",
    "Payload.height_m",
    "SimulateRequest.torque_schedule",
    "SimulatedPlan.answer",
    "SimulatedPlan.request",
    "SolvedPlan.answer",
    "SolvedPlan.request",
    "InitialGuess.final_time_s",
    "InitialGuess.torque_left_n_m",
    "InitialGuess.torque_right_n_m",
    "TorqueSchedule.interval_s",
    "TorqueSchedule.left_n_m",
    "TorqueSchedule.right_n_m",
    "Uncertainty.parameter",
];
/// Answers that requests hold: they are read as answers.
const ANSWERS: [&str; 2] = ["SimulatedPlan.answer", "SolvedPlan.answer"];
/// Messages in answers that are left out where there are none; all others are always there.
const LEFT_OUT: [&str; 8] = [
    "Report.limits",
    "Report.sensitivity",
    "SimulateResponse.limits",
    "Solution.contacts",
    "Solution.robot",
    "Solution.trajectory",
    "ValidateResponse.initial_guess",
    "ValidateResponse.payload",
];
/// Fields in answers that are null where there are none.
const NULL: [&str; 8] = [
    "AssessResponse.worst",
    "LimitUse.replay_excess",
    "Report.least_normal_load",
    "Report.lower_bound_assumption",
    "Report.replay",
    "Sensitivity.end_shift_m",
    "Sensitivity.end_shift_rad",
    "Solution.reason",
];
/// Numbers in answers that may not be finite, because a motion diverges or nothing was computed; JSON has null for them.
/// An entry without a field means all numbers of the message but times.
const NOT_FINITE: [&str; 21] = [
    "Contact",
    "EndErrors",
    "EndState",
    "ExportResponse",
    "GoalError",
    "LimitUse.excess",
    "LimitUse.largest",
    "NormalLoad.share",
    "PlanInWords.end_difference",
    "Progress.best_final_time_s",
    "Progress.best_goal_error",
    "Reason.value",
    "Replay",
    "Report.lower_bound_s",
    "Report.predicted_decrease_s",
    "Report.worst_contact_residual",
    "Separation.normal_force_n",
    "SimulateResponse.worst_contact_residual",
    "Trajectory",
    "VarianceShares",
    "WorstSample.relative_error",
];
/// Messages in messages that would make those that hold them too large: calls for the stack, plans for as many empty ones as a message
/// can have.
const BOXED: [&str; 7] = [
    "AssessRequest.solve",
    "AssessRequest.simulate",
    "AssessResponse.worst",
    "ExportRequest.solve",
    "ExportRequest.simulate",
    "PresentedPlan.solve",
    "PresentedPlan.simulate",
];
/// Calls whose message has the same fields as that of another call, so that both are one type.
const SAME: [(&str, &str); 2] = [("SolveStreamRequest", "SolveRequest"), ("ValidateRequest", "SolveRequest")];
/// Where the generated code finds the functions that read and write JSON.
const JSON: &str = "crate::contract::json";
/// What it says of their numbers.
const NUMBERS: &str = "crate::contract::Numbers";

pub(crate) fn generate() -> Result<(), Box<dyn Error>> {
    for path in ["proto", "build.rs", "build"] {
        println!("cargo:rerun-if-changed={path}");
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(true).open_files(["slipdrive/v1/maneuver_service.proto"])?;
    // What server reflection answers with.
    fs::write(out.join("descriptor.bin"), compiler.encode_file_descriptor_set())?;
    let (pool, files) = (compiler.descriptor_pool(), compiler.file_descriptor_set());
    check_lists(&pool)?;
    for folder in ["contract", "grpc"] {
        fs::create_dir_all(out.join(folder))?;
    }
    messages_with_json(&pool).out_dir(out.join("contract")).compile_fds(files.clone())?;
    fs::write(out.join("contract/names.rs"), names_of_enums(&pool) + &known_fields(&pool) + &numbers(&pool))?;
    service(&pool).out_dir(out.join("grpc")).compile_fds(files)?;
    Ok(())
}

/// A misspelt entry would change the contract in silence.
fn check_lists(pool: &DescriptorPool) -> Result<(), String> {
    for path in REQUIRED.iter().chain(&ANSWERS).chain(&LEFT_OUT).chain(&NULL).chain(&NOT_FINITE).chain(&BOXED) {
        let (message, field) = path.split_once('.').unwrap_or((path, ""));
        let message = pool.get_message_by_name(&format!("{PACKAGE}.{message}"));
        let is_known = message.is_some_and(|message| field.is_empty() || message.get_field_by_name(field).is_some());
        if !is_known {
            return Err(format!("{path} is no field of proto/"));
        }
    }
    let fields_of = |name: &str| {
        let message = pool.get_message_by_name(&format!("{PACKAGE}.{name}"));
        let text = |field: FieldDescriptor| format!("{field:?}").replace(name, "");
        message.map(|message| message.fields().map(text).collect::<Vec<_>>())
    };
    match SAME.iter().find(|(name, same)| fields_of(name).is_none() || fields_of(name) != fields_of(same)) {
        Some((name, same)) => Err(format!("{name} does not have the fields of {same}")),
        None => Ok(()),
    }
}

/// The messages, as JSON and as schemas too.
fn messages_with_json(pool: &DescriptorPool) -> Builder {
    // A type from elsewhere is not generated.
    let skip = |builder: Builder, name: &str| builder.extern_path(format!(".{name}"), "()");
    let mut builder = skip(tonic_prost_build::configure().build_client(false).build_server(false), "google.rpc.Status");
    let requests = messages_of_requests(pool);
    for message in messages(pool) {
        let path = message.full_name();
        if is_alternatives(&message) || SAME.iter().any(|(name, _)| *name == message.name()) {
            builder = skip(builder, path);
            continue;
        }
        let is_request = requests.contains(path);
        builder =
            builder.type_attribute(path, "#[derive(::serde::Serialize, ::serde::Deserialize, ::utoipa::ToSchema)]");
        if is_request {
            builder = builder.type_attribute(path, "#[serde(deny_unknown_fields)]");
        }
        for field in message.fields() {
            let attributes = if is_request { in_request(&field) } else { in_answer(&field, &requests) };
            if is_listed(&BOXED, &field) {
                builder = builder.boxed(format!(".{}", field.full_name()));
            }
            if !attributes.is_empty() {
                builder = builder.field_attribute(field.full_name(), attributes);
            }
        }
    }
    builder
}

/// The service, and the messages that only its streams have.
fn service(pool: &DescriptorPool) -> Builder {
    let contract = |name: &str| format!("crate::contract::message::{name}");
    let mut builder = tonic_prost_build::configure()
        .build_client(true)
        .build_server(true)
        // Clients bring a channel of their own.
        .build_transport(false)
        .extern_path(".google.rpc.Status", "::tonic_types::Status");
    for message in messages(pool).filter(|message| !is_alternatives(message)) {
        let same = SAME.iter().find(|(name, _)| *name == message.name());
        let name = same.map_or(message.name(), |(_, same)| same);
        builder = builder.extern_path(format!(".{}", message.full_name()), contract(name));
    }
    for of in enums(pool) {
        builder = builder.extern_path(format!(".{}", of.full_name()), contract(of.name()));
    }
    builder
}

fn messages(pool: &DescriptorPool) -> impl Iterator<Item = MessageDescriptor> {
    pool.all_messages().filter(|message| message.package_name() == PACKAGE)
}

fn enums(pool: &DescriptorPool) -> impl Iterator<Item = EnumDescriptor> {
    pool.all_enums().filter(|of| of.package_name() == PACKAGE)
}

/// Whether it is a message of alternatives: streams of gRPC have them, JSON has none.
fn is_alternatives(message: &MessageDescriptor) -> bool {
    message.oneofs().any(|oneof| !oneof.is_synthetic())
}

/// Full names of requests and of all messages in them.
fn messages_of_requests(pool: &DescriptorPool) -> BTreeSet<String> {
    let mut open: Vec<_> = messages(pool).filter(|message| message.name().ends_with("Request")).collect();
    let mut found = BTreeSet::new();
    while let Some(message) = open.pop() {
        if found.insert(message.full_name().to_owned()) {
            let asked = message.fields().filter(|field| !is_listed(&ANSWERS, field));
            open.extend(asked.filter_map(|field| field.kind().as_message().cloned()));
        }
    }
    found
}

fn is_listed(list: &[&str], field: &FieldDescriptor) -> bool {
    let (message, name) = (field.parent_message().name().to_owned(), field.name());
    list.iter().any(|entry| *entry == message || *entry == format!("{message}.{name}"))
}

/// In requests an absent field has its default, and null is refused.
fn in_request(field: &FieldDescriptor) -> String {
    let is_required = is_listed(&REQUIRED, field);
    let default = if is_required { "" } else { "default, " };
    let optional = |read: &str, of: &str| {
        format!(
            "#[serde({default}deserialize_with = \"{JSON}::{read}\", skip_serializing_if = \"Option::is_none\")]\n\
             #[schema(value_type = {of}, required = {is_required})]"
        )
    };
    match field.kind() {
        Kind::Enum(of) => {
            // What is not said is not written either: it would be null.
            let skip = format!("skip_serializing_if = \"{JSON}::is_unspecified\", ");
            format!("#[serde({default}{skip}{})]\n{}", named(&of), schema_of(of.name(), is_required))
        }
        Kind::Message(of) if field.is_list() => {
            let read = format!("deserialize_with = \"{JSON}::objects\", skip_serializing_if = \"Vec::is_empty\"");
            format!("#[serde({default}{read})]\n{}", schema_of(&format!("Vec<{}>", of.name()), is_required))
        }
        Kind::Message(of) => optional("some_object", of.name()),
        Kind::Double if field.supports_presence() => optional("some_value", "f64"),
        Kind::String if field.supports_presence() => optional("some_value", "String"),
        Kind::Uint32 if field.supports_presence() => optional("some_count", "u32"),
        Kind::Uint64 if field.supports_presence() => optional("some_long_count", "u64"),
        Kind::Uint64 | Kind::Int64 => {
            // The format of any 64 bits has no sign.
            let without_sign = "\n#[schema(format = \"uint64\", maximum = 18446744073709551615_u64)]";
            let schema = if field.kind() == Kind::Uint64 { without_sign } else { "" };
            format!("#[serde(default, deserialize_with = \"{JSON}::whole_number\")]{schema}")
        }
        _ if is_required => String::new(),
        _ => "#[serde(default)]".to_owned(),
    }
}

/// In answers a field is always there, apart from what the lists say. Readers take null and what an older server does not
/// send for a default, and ignore what a newer one adds, also where a message is strict in requests.
fn in_answer(field: &FieldDescriptor, requests: &BTreeSet<String>) -> String {
    let read = |function: &str| format!("#[serde(default, deserialize_with = \"{JSON}::{function}\")]");
    let function = match field.kind() {
        Kind::Message(_) if field.is_list() => "objects_or_none",
        Kind::Message(of) if requests.contains(of.full_name()) => "known_object",
        Kind::Message(_) => "object_or_none",
        Kind::Uint32 | Kind::Uint64 if !field.is_list() && !field.supports_presence() => "whole_or_zero",
        _ => "value_or_default",
    };
    let plain = read(function);
    let left_out = format!(
        "#[serde(default, deserialize_with = \"{JSON}::{function}\", skip_serializing_if = \"Option::is_none\")]"
    );
    let no_items = format!(
        "#[serde(default, deserialize_with = \"{JSON}::{function}\", skip_serializing_if = \"Vec::is_empty\")]"
    );
    let (serde, schema) = match field.kind() {
        Kind::Enum(of) if is_listed(&NULL, field) => {
            (format!("#[serde(default, {})]", named_or_null(&of)), schema_of(&format!("Option<{}>", of.name()), true))
        }
        Kind::Enum(of) => (format!("#[serde(default, {})]", named_or_null(&of)), schema_of(of.name(), true)),
        Kind::Message(of) if field.is_list() && is_listed(&LEFT_OUT, field) => {
            (no_items, schema_of(&format!("Vec<{}>", of.name()), false))
        }
        Kind::Message(of) if field.is_list() => (plain, schema_of(&format!("Vec<{}>", of.name()), true)),
        Kind::Message(of) if is_listed(&NULL, field) => (plain, schema_of(&format!("Option<{}>", of.name()), true)),
        Kind::Message(of) if is_listed(&LEFT_OUT, field) => (left_out, schema_of(of.name(), false)),
        Kind::Message(of) => (plain, schema_of(of.name(), true)),
        Kind::Double if is_listed(&NULL, field) => (plain, schema_of("Option<f64>", true)),
        Kind::Double if field.name() != "time_s" && is_listed(&NOT_FINITE, field) => {
            match (field.is_list(), field.supports_presence()) {
                (true, _) => (read("read_numbers"), schema_of("Vec<Option<f64>>", true)),
                (false, true) => (left_out, schema_of("Option<f64>", false)),
                (false, false) => (read("read_number"), schema_of("Option<f64>", true)),
            }
        }
        Kind::Double if field.supports_presence() => (left_out, schema_of("f64", false)),
        _ => (plain, "#[schema(required = true)]".to_owned()),
    };
    format!("{serde}\n{schema}")
}

fn schema_of(of: &str, is_required: bool) -> String {
    format!("#[schema(value_type = {of}, required = {is_required})]")
}

fn named(of: &EnumDescriptor) -> String {
    by_name(of, "read_name")
}

fn named_or_null(of: &EnumDescriptor) -> String {
    by_name(of, "read_name_or_null")
}

fn by_name(of: &EnumDescriptor, read: &str) -> String {
    let name = of.name();
    format!("serialize_with = \"{JSON}::write_name::<_, {name}>\", deserialize_with = \"{JSON}::{read}::<_, {name}>\"")
}

/// The names of enums in JSON: those of protobuf without their prefix, in lower case.
fn names_of_enums(pool: &DescriptorPool) -> String {
    let mut text = String::new();
    for of in enums(pool) {
        let prefix = of.default_value().name().strip_suffix("UNSPECIFIED").unwrap_or_default().to_owned();
        let names: Vec<String> = of
            .values()
            .filter(|value| value.number() != 0)
            .map(|value| {
                let name = value.name().strip_prefix(&prefix).unwrap_or(value.name()).to_lowercase();
                format!("({}, {name:?}, {:?}), ", value.number(), comment_at(&of, value.path()))
            })
            .collect();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "impl {JSON}::Named for {} {{\n\
             const MEANING: &'static str = {:?};\n\
             const NAMES: &'static [(i32, &'static str, &'static str)] = &[{}];\n}}\n\
             {JSON}::schema_of_names!({0});",
            of.name(),
            comment_at(&of, of.path()),
            names.concat(),
        );
    }
    text
}

/// The messages of requests that are generated.
fn generated_of_requests(pool: &DescriptorPool) -> Vec<MessageDescriptor> {
    let requests = messages_of_requests(pool);
    let is_generated = |message: &MessageDescriptor| {
        requests.contains(message.full_name())
            && !is_alternatives(message)
            && SAME.iter().all(|(name, _)| *name != message.name())
    };
    messages(pool).filter(is_generated).collect()
}

/// The fields of messages of requests, for where answers hold them.
fn known_fields(pool: &DescriptorPool) -> String {
    let generated = generated_of_requests(pool);
    let mut text = String::new();
    for message in &generated {
        let below = |field: &FieldDescriptor| match field.kind() {
            Kind::Message(of) if generated.contains(&of) => format!("Some({JSON}::keep_known::<{}>)", of.name()),
            _ => "None".to_owned(),
        };
        let fields: Vec<_> =
            message.fields().map(|field| format!("({:?}, {}), ", field.name(), below(&field))).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "impl {JSON}::Known for {} {{\nconst FIELDS: &'static [{JSON}::KnownField] = &[{}];\n}}",
            message.name(),
            fields.concat()
        );
    }
    text
}

/// Where messages of requests have their numbers; those of answers in them stay as they are.
fn numbers(pool: &DescriptorPool) -> String {
    let generated = generated_of_requests(pool);
    let mut text = String::new();
    for message in &generated {
        let has_numbers = |field: &FieldDescriptor| match field.kind() {
            Kind::Double => true,
            Kind::Message(of) => generated.contains(&of),
            _ => false,
        };
        let fields: Vec<_> = message
            .fields()
            .filter(has_numbers)
            .map(|field| format!("{NUMBERS}::unify_zeros(&mut self.{}); ", field.name()))
            .collect();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "impl {NUMBERS} for {} {{\nfn unify_zeros(&mut self) {{ {}}}\n}}",
            message.name(),
            fields.concat()
        );
    }
    text
}

/// The comment before a declaration, in one line.
fn comment_at(of: &EnumDescriptor, path: &[i32]) -> String {
    let file = of.parent_file();
    let locations = file.file_descriptor_proto().source_code_info.iter().flat_map(|info| &info.location);
    let comment = locations.filter(|location| location.path == path).find_map(|at| at.leading_comments.clone());
    comment.unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ")
}
