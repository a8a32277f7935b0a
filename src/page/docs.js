// The API for people: /openapi.json as headings and tables. Texts of the document become text nodes.

/** @typedef {Record<string, any>} Schema an object of the document */
/** @typedef {string | Node} Content */

/** @param {string} name @param {...Content} children */
const element = (name, ...children) => {
  const made = document.createElement(name);
  made.append(...children);
  return made;
};

/** @param {string} name of a schema */
const link = (name) => Object.assign(document.createElement("a"), { href: "#" + name, textContent: name });

/** @param {Schema} [schema] @returns {Content} */
const typeOf = (schema) => {
  if (!schema) return "";
  if (schema.$ref) return element("code", link(schema.$ref.split("/").pop()));
  if (schema.enum) return schema.enum.map((/** @type {unknown} */ value) => JSON.stringify(value)).join(" | ");
  /** @type {Schema[] | undefined} */
  const options = schema.oneOf ?? schema.allOf ?? schema.anyOf;
  if (options) {
    return element("span", ...options.flatMap((option, index) => [index ? ", " : "", typeOf(option)]));
  }
  if (schema.items) return element("span", "array of ", typeOf(schema.items));
  return [schema.type ?? "any"].flat().join(" | ");
};

/** What a number, or the length of an array, must be. @param {Schema} schema */
const boundsOf = ({ minimum, exclusiveMinimum, maximum, exclusiveMaximum, minItems, maxItems }) =>
  [
    minimum !== undefined ? `at least ${minimum}` : "",
    exclusiveMinimum !== undefined ? `above ${exclusiveMinimum}` : "",
    maximum !== undefined ? `at most ${maximum}` : "",
    exclusiveMaximum !== undefined ? `below ${exclusiveMaximum}` : "",
    minItems !== undefined || maxItems !== undefined ? `${minItems ?? 0} to ${maxItems ?? "any number of"} items` : "",
  ]
    .filter(Boolean)
    .join(", ");

/**
 * A table whose first column names its rows.
 * @param {string} caption @param {string[]} head @param {Content[][]} rows
 */
const table = (caption, head, rows) => {
  const heads = head.map((title) => Object.assign(document.createElement("th"), { scope: "col", textContent: title }));
  const body = rows.map(([first, ...cells]) => {
    const name = Object.assign(document.createElement("th"), { scope: "row" });
    name.append(element("code", first ?? ""));
    return element("tr", name, ...cells.map((cell) => element("td", cell)));
  });
  const made = element("table", element("thead", element("tr", ...heads)), element("tbody", ...body));
  made.setAttribute("aria-label", caption);
  return made;
};

/** @param {Record<string, Schema>} [content] @returns {Content} */
const bodyOf = (content) => {
  const [media, body] = Object.entries(content ?? {})[0] ?? [];
  return media && body ? element("span", element("code", media), " ", typeOf(body.schema)) : "";
};

/** @param {string} path @param {string} method @param {Schema} about */
const operation = (path, method, about) => {
  const name = method.toUpperCase() + " " + path;
  /** @type {Schema[]} */
  const parameters = about.parameters ?? [];
  const taken = parameters.map((each) => [each.name, typeOf(each.schema), each.description]);
  const answers = Object.entries(about.responses).map(([status, each]) => [status, bodyOf(each.content), each.description]);
  return [
    element("h3", element("code", name)),
    element("p", about.summary ?? ""),
    ...(about.description ? [element("p", about.description)] : []),
    ...(about.requestBody ? [element("p", "Body: ", bodyOf(about.requestBody.content))] : []),
    ...(taken.length ? [table(`Headers of ${name}`, ["header", "type", "meaning"], taken)] : []),
    table(`Answers of ${name}`, ["status", "answer", "meaning"], answers),
  ];
};

/** @param {string} name @param {Schema} schema */
const message = (name, schema) => {
  /** @type {Schema[]} */
  const parts = [...(schema.allOf ?? []), schema];
  /** @type {[string, Schema][]} */
  const fields = parts.flatMap((part) => Object.entries(part.properties ?? {}));
  const rows = fields.map(([field, each]) => [
    field,
    typeOf(each),
    boundsOf(each),
    each.description ?? each.oneOf?.[0]?.description ?? "",
  ]);
  return [
    Object.assign(element("h3", element("code", name)), { id: name }),
    Object.assign(element("p", schema.description ?? ""), { className: "lines" }),
    schema.enum ? element("p", typeOf(schema)) : table(`Fields of ${name}`, ["field", "type", "bounds", "meaning"], rows),
  ];
};

/** @param {Schema} api @returns {Content[]} */
const all = (api) => [
  element("h2", "Endpoints"),
  ...Object.entries(api.paths).flatMap(([path, methods]) =>
    Object.entries(methods).flatMap(([method, about]) => operation(path, method, about)),
  ),
  element("h2", "Messages"),
  ...Object.entries(api.components.schemas).flatMap(([name, schema]) => message(name, schema)),
];

const place = document.getElementById("api");
try {
  place?.replaceChildren(...all(await (await fetch("openapi.json")).json()));
  // The place that the link names was not there when the page was opened.
  document.getElementById(decodeURIComponent(location.hash.slice(1)))?.scrollIntoView();
} catch (error) {
  place?.replaceChildren(`/openapi.json cannot be read: ${error}`);
}

// A module, so that it may wait.
export {};
