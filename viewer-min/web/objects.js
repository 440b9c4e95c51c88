// What the input named: a tree that is read as it is opened, a search, and what is selected, hidden and shown alone.

import { objectsOf } from 'lodpack/objects';

/** Rows that are added at once. */
const MOST_ROWS = 200;
const ORDER = new Intl.Collator(undefined, { numeric: true });
const title = ({ name, id, number }) => name || id || `#${number}`;

export class ObjectPanel {
  #objects = null;
  #surface;
  #choice;
  #filter = null;
  #marked = null; // The surface of what is selected.
  #selected = null;
  #selecting = Promise.resolve(); // What was asked for last.
  #turn = Promise.resolve(); // One change after the other.

  /** `changed()` hears when something looks different, `fly(box)` goes to a box, `failed(error)` hears of errors. */
  constructor(root, name, { changed, fly, failed }) {
    Object.assign(this, { root, name, changed, fly, failed });
    const [search, tree] = [root.querySelector('input'), root.querySelector('ul')];
    Object.assign(this, { search, tree });
    search.addEventListener('keydown', (event) => {
      event.stopPropagation();
      if (event.key === 'Enter') this.find(search.value.trim());
      if (event.key === 'Escape') search.blur();
    });
    search.addEventListener('search', () => { if (search.value === '') this.find(''); });
    for (const button of root.querySelectorAll('button[data-do]')) button.addEventListener('click', () => this.act(button.dataset.do));
  }

  /** What is drawn over the surface. */
  get marked() {
    return this.#marked;
  }

  get selected() {
    return this.#selected;
  }

  get choice() {
    return this.#choice;
  }

  get count() {
    return this.#objects?.count ?? 0;
  }

  /** Shows the objects of a surface, if its file has any. */
  async open(surface) {
    this.close();
    const objects = await objectsOf(surface.file);
    [this.#objects, this.#surface] = [objects, surface];
    this.#choice = { only: null, hidden: [], marked: [] };
    this.root.hidden = !objects;
    this.search.value = '';
    if (objects) await this.find('');
  }

  close() {
    this.#marked?.end();
    [this.#objects, this.#surface, this.#filter, this.#marked, this.#selected] = [null, null, null, null, null];
    this.tree.replaceChildren();
    [this.root.hidden, this.name.hidden] = [true, true];
  }

  /** Lists what has a name or an id, with paths; the tree again without any. */
  async find(text) {
    const objects = this.#objects;
    const list = document.createElement('ul');
    try {
      if (text === '') {
        await this.#fill(list, objects.children());
      } else {
        const found = await objects.find(text);
        const nodes = await objects.nodes(found.slice(0, MOST_ROWS));
        for (const node of nodes) {
          const row = this.#row(node);
          const path = (await objects.above(node.number)).map(title).join(' / ');
          row.querySelector('.name').title = path;
          row.append(Object.assign(document.createElement('small'), { textContent: path }));
          list.append(row);
        }
        if (nodes.length === 0) list.append(Object.assign(document.createElement('li'), { textContent: 'Nothing has this name or id.' }));
        if (nodes.length > 0) this.select(nodes[0].number);
      }
      if (this.#objects !== objects) return;
      this.tree.replaceChildren(...list.childNodes);
      this.tree.scrollTop = 0;
    } catch (error) {
      this.failed(error);
    }
  }

  /** Adds children to a list: all by their names, or, of very many, some as the file has them and a button for more. */
  async #fill(list, pages, waiting = []) {
    let isAll = false;
    while (waiting.length < MOST_ROWS && !isAll) {
      const { value, done } = await pages.next();
      waiting.push(...(value ?? []));
      isAll = done;
    }
    if (isAll && list.children.length === 0) waiting.sort((a, b) => ORDER.compare(title(a), title(b)));
    list.append(...waiting.splice(0, MOST_ROWS).map((node) => this.#row(node)));
    if (waiting.length === 0) {
      // Whether more follows is known when it is asked for.
      const { value, done } = await pages.next();
      if (done) return;
      waiting.push(...value);
    }
    const more = Object.assign(document.createElement('button'), { textContent: 'more …', className: 'more' });
    more.addEventListener('click', () => {
      more.remove();
      this.#fill(list, pages, waiting).catch(this.failed);
    });
    list.append(more);
  }

  #row(node) {
    const row = document.createElement('li');
    const toggle = Object.assign(document.createElement('button'), { textContent: '▸', className: 'toggle' });
    const name = Object.assign(document.createElement('span'), { textContent: title(node), className: 'name' });
    row.dataset.number = node.number;
    toggle.setAttribute('aria-label', `What ${title(node)} consists of`);
    // Hardly any object has others below it.
    if (node.isObject) toggle.classList.add('faint');
    toggle.addEventListener('click', () => this.#open(row, toggle, node.number).catch(this.failed));
    name.addEventListener('click', () => this.select(node.number));
    name.addEventListener('dblclick', () => this.act('go'));
    row.append(toggle, name);
    this.#mark(row);
    return row;
  }

  async #open(row, toggle, number) {
    const list = row.querySelector('ul');
    if (list) {
      list.remove();
      toggle.textContent = '▸';
      return;
    }
    const below = document.createElement('ul');
    row.append(below);
    toggle.textContent = '▾';
    await this.#fill(below, this.#objects.children(number));
    if (below.children.length === 0) {
      below.remove();
      toggle.classList.add('leaf');
    }
  }

  /** How a row looks. */
  #mark(row) {
    const number = Number(row.dataset.number);
    row.classList.toggle('selected', number === this.#selected?.number);
    row.classList.toggle('hidden-object', this.#choice.hidden.includes(number));
  }

  /** Selects a node, or nothing. */
  select(number) {
    return this.#next(() => number);
  }

  /** Selects what a ray meets first. */
  pick(origin, direction) {
    return this.#next(async () => (await this.#objects?.pick({ origin, direction }, this.#filter))?.number ?? null);
  }

  /** Selects what is found, after all that was asked for before: reading names takes time. */
  #next(find) {
    this.#selecting = this.#selecting.then(() => this.#find(find)).catch(this.failed);
    return this.#selecting;
  }

  async #find(find) {
    const objects = this.#objects;
    if (!objects) return;
    const number = await find();
    const node = number === null ? null : await objects.node(number);
    const above = node ? await objects.above(number) : [];
    if (this.#objects === objects) this.#tell(node, above);
  }

  #tell(node, above) {
    this.#selected = node;
    this.name.hidden = !node;
    if (node) {
      const [path, own, id] = this.name.querySelectorAll('span');
      path.textContent = above.map((each) => `${title(each)} / `).join('');
      own.textContent = title(node);
      id.textContent = node.id && node.id !== title(node) ? ` · ${node.id}` : '';
    }
    this.#apply({ marked: node ? [node.number] : [] });
  }

  /** `hide` or `isolate` what is selected, `all`: show everything again, `go` to it, `none`: select nothing. */
  async act(what) {
    if (what === 'all') return this.#apply({ only: null, hidden: [] });
    if (what === 'none') return this.select(null);
    await this.#selecting;
    const number = this.#selected?.number;
    if (number === undefined) return undefined;
    if (what === 'isolate') return this.#apply({ only: [number], hidden: this.#choice.hidden.filter((other) => other !== number) });
    if (what === 'go') {
      const box = await this.#objects.bounds([number]).catch(this.failed);
      return box && this.fly(box);
    }
    this.#choice = { ...this.#choice, hidden: [...new Set([...this.#choice.hidden, number])] };
    this.#tell(null);
    return this.#turn;
  }

  #apply(change) {
    this.#choice = { ...this.#choice, ...change };
    this.tree.querySelectorAll('li[data-number]').forEach((row) => this.#mark(row));
    const turn = this.#turn.then(() => this.#show(this.#choice));
    this.#turn = turn.catch(this.failed);
    return this.#turn;
  }

  async #show(choice) {
    const [objects, surface] = [this.#objects, this.#surface];
    // A later choice is waiting.
    if (!objects || choice !== this.#choice) return;
    const { only, hidden, marked } = choice;
    const filter = only || hidden.length > 0 || marked.length > 0 ? await objects.filter(choice) : null;
    const above = marked.length > 0 ? await objects.filter({ ...choice, onlyMarked: true }) : null;
    await objects.show(surface.stream, filter);
    if (above && !this.#marked) this.#marked = await surface.above();
    if (above) await objects.show(this.#marked.stream, above);
    if (this.#objects !== objects) return;
    if (!above) {
      this.#marked?.end();
      this.#marked = null;
    }
    this.#filter?.close();
    above?.close(); // The stream keeps it.
    this.#filter = filter;
    if (this.#marked) this.#marked.stream.onprogress = this.changed;
    this.changed();
  }
}
