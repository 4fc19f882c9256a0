// What every part of the page begins with.

export class PagePart {
  constructor(/** @type {Page} */ page) {
    this.page = page;
    this.canvas = page.canvas;
  }
}
