// Lets Node read the page's modules as modules, as the browser does.

import { registerHooks } from "node:module";

registerHooks({
  load: (url, context, next) =>
    next(url, url.includes("/static/") && url.endsWith(".js") ? { ...context, format: "module" } : context),
});
