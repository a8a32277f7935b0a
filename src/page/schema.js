// What a request may hold, with unit, meaning and range: read from the service's own documents.

/** @typedef {import("slipdrive-api").components["schemas"]["GetLimitsResponse"]} Limits */
/**
 * @typedef {{ path: string[], label: string, unit: string, meaning: string, range: string } &
 *   ({ kind: "number", whole: boolean } | { kind: "choice", options: { value: string, meaning: string }[] }
 *   | { kind: "points", axes: string[] })} Field
 */
/** @typedef {{ path: string[], meaning: string, fields: Field[], groups: Group[] }} Group */

/**
 * The fields of a message and of the messages in it.
 * @param {any} document OpenAPI
 * @param {Limits} limits
 * @param {string} message
 * @returns {Group}
 */
export function groupOf(document, limits, message) {
  const rules = new Map(limits.rules.filter(({ job }) => job === "solve").map((rule) => [rule.field, rule]));
  const schemas = document.components.schemas;

  /** @param {any} schema @param {string[]} path @param {string} meaning @returns {Group} */
  const group = (schema, path, meaning) => {
    /** @type {Group} */
    const made = { path, meaning, fields: [], groups: [] };
    for (const [name, property] of Object.entries(schema.properties)) {
      const at = [...path, name];
      const { about, described } = resolve(property);
      if (about.properties) made.groups.push(group(about, at, described));
      else made.fields.push(...field(at, about, described));
    }
    return made;
  };

  /** @param {any} property */
  const resolve = (property) => {
    const reference = property.$ref ?? property.oneOf?.[0].$ref ?? property.allOf?.[0].$ref;
    const about = reference ? schemas[reference.split("/").pop()] : property;
    return { about, described: property.description ?? property.oneOf?.[0].description ?? about.description ?? "" };
  };

  /** @param {string[]} path @param {any} about @param {string} described @returns {Field[]} */
  const field = (path, about, described) => {
    const rule = rules.get(path.join("."));
    const unit = rule?.unit === "items" ? "" : (rule?.unit ?? "");
    const common = { path, label: labelOf(path), unit, meaning: described, range: rule?.rule ?? "" };
    if (about.enum) return [{ ...common, kind: "choice", options: optionsOf(about) }];
    if (about.type === "number" || about.type === "integer") {
      return [{ ...common, kind: "number", whole: about.type === "integer" }];
    }
    const item = about.type === "array" ? resolve(about.items).about : {};
    if (!item.properties) return [];
    return [{ ...common, kind: "points", axes: Object.keys(item.properties).sort(rightFirst), unit: "m" }];
  };

  return group(schemas[message], [], "");
}

/** Right before forward, x before y. @param {string} a @param {string} b */
const rightFirst = (a, b) => "right_m x_m forward_m y_m".indexOf(a) - "right_m x_m forward_m y_m".indexOf(b);

const UNIT = /_(n_m_s|n_m|kg_m2|kg|m_s2|m_s|m|rad_s2|rad_s|rad|s)$/;

/**
 * The name of a field in words: without its unit.
 * @param {string[]} path
 */
export function labelOf(path) {
  const words = path[path.length - 1].replace(UNIT, "").replaceAll("_", " ");
  return words.length > 1 ? words[0].toUpperCase() + words.slice(1) : words;
}

/** Values of an enumeration; the document says their meaning line by line. @param {any} about */
function optionsOf(about) {
  const lines = String(about.description ?? "").split("\n");
  return about.enum.map((/** @type {string} */ value) => {
    const line = lines.find((each) => each.startsWith(`- \`${value}\`: `)) ?? "";
    return { value, meaning: line.slice(line.indexOf(": ") + 2) };
  });
}
