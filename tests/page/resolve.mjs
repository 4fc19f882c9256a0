// Lets Node find the page's modules where the browser does: below /static/.

import { registerHooks } from "node:module";
import { pathToFileURL } from "node:url";

const ROOT = pathToFileURL(`${process.cwd()}/`).href;

registerHooks({
  resolve: (specifier, context, next) =>
    next(specifier.startsWith("/static/") ? ROOT + specifier.slice(1) : specifier, context),
  load: (url, context, next) =>
    next(url, url.includes("/static/") && url.endsWith(".js") ? { ...context, format: "module" } : context),
});
