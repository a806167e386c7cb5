/** How GLB files are read. */

const ARRAYS = {
  5121: Uint8Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array,
};
/** Numbers of one element of an accessor. */
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT4: 16 };

/** The document of a GLB, `array(accessor)`: its numbers one after the other, as stored; and its first `picture`. */
export function readGlb(content) {
  const header = new Uint32Array(content, 0, 5); // as in glTF, the lower byte comes first
  if (header[0] !== 0x46546c67) throw new Error("This is not a GLB file.");
  if (header[2] !== content.byteLength) throw new Error("The GLB file is incomplete.");
  const jsonLength = header[3];
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(content, 20, jsonLength)));

  function stored(view, componentType, length) {
    const offset = 20 + jsonLength + 8 + document.bufferViews[view].byteOffset;
    return new ARRAYS[componentType](content, offset, length);
  }

  /** A sparse accessor gives `{ indices, values }`: all else of it is zero. */
  function array(accessor) {
    const { sparse, bufferView, componentType, count, type } = document.accessors[accessor];
    if (!sparse) return stored(bufferView, componentType, count * WIDTHS[type]);
    const { indices, values } = sparse;
    return {
      indices: stored(indices.bufferView, indices.componentType, sparse.count),
      values: stored(values.bufferView, componentType, sparse.count * WIDTHS[type]),
    };
  }

  /** Bytes of the first picture. */
  function picture() {
    const { bufferView } = document.images[0];
    return stored(bufferView, 5121, document.bufferViews[bufferView].byteLength);
  }

  return { document, array, picture };
}
