/** A dropped folder as a zip, nothing of it packed: what a run leaves is opened again as if it had been zipped. */

const ENDINGS = /\.(json|npz|wav)$/i;
const MAX_FILES = 2000;
const TABLE = Uint32Array.from({ length: 256 }, (_, each) => {
  let value = each;
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value;
});

/**
 * What is needed of a folder to show its run, by the names that it has there.
 *
 * @param {FileSystemDirectoryEntry} folder
 * @returns {Promise<Map<string, File>>}
 */
export async function filesOf(folder) {
  const found = new Map();
  const pending = [{ folder, path: "" }];
  for (const { folder: each, path } of pending) {
    for (const entry of await entriesOf(each)) {
      const name = `${path}${entry.name}`;
      if (entry.isDirectory && !path) pending.push({ folder: /** @type {FileSystemDirectoryEntry} */ (entry), path: `${name}/` });
      else if (entry.isFile && ENDINGS.test(name) && found.size < MAX_FILES) found.set(name, await fileOf(/** @type {FileSystemFileEntry} */ (entry)));
    }
  }
  return found;
}

/** A reader gives a hundred at a time. */
async function entriesOf(folder) {
  const reader = folder.createReader(), all = [];
  for (;;) {
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!some.length) return all;
    all.push(...some);
  }
}

function fileOf(entry) {
  return new Promise((resolve, reject) => entry.file(resolve, reject));
}

/**
 * @param {Map<string, Blob>} files by name
 * @returns {Promise<Blob>}
 */
export async function zipped(files) {
  const parts = [], list = [];
  let at = 0;
  for (const [name, file] of files) {
    const bytes = new TextEncoder().encode(name), content = new Uint8Array(await file.arrayBuffer());
    const size = [content.length, 4];
    const head = fields([[20, 2], [0x0800, 2], [0, 2], [0, 4], [sumOf(content), 4], size, size, [bytes.length, 2], [0, 2]]);
    parts.push(fields([[0x04034b50, 4]]), head, bytes, content);
    list.push(fields([[0x02014b50, 4], [20, 2]]), head, fields([[0, 2], [0, 2], [0, 2], [0, 4], [at, 4]]), bytes);
    at += 4 + head.length + bytes.length + content.length;
  }
  const length = list.reduce((sum, each) => sum + each.length, 0);
  return new Blob([...parts, ...list, fields([[0x06054b50, 4], [0, 4], [files.size, 2], [files.size, 2], [length, 4], [at, 4], [0, 2]])]);
}

/** Numbers of so many bytes each, the lowest byte first. */
function fields(numbers) {
  const bytes = new Uint8Array(numbers.reduce((sum, [, size]) => sum + size, 0));
  let at = 0;
  for (const [value, size] of numbers) for (let byte = 0; byte < size; byte++) bytes[at++] = (value >>> (8 * byte)) & 255;
  return bytes;
}

function sumOf(content) {
  let sum = 0xffffffff;
  for (const byte of content) sum = TABLE[(sum ^ byte) & 255] ^ (sum >>> 8);
  return (sum ^ 0xffffffff) >>> 0;
}
