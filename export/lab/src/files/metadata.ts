/** The metadata of an ONNX file, read without a parser of its graph: entries of field 14 of ModelProto (protobuf). */

const METADATA_PROPS = 14;

/** Key and value of every entry; null if the bytes are no sequence of protobuf fields. */
export function metadata(bytes: Uint8Array): Map<string, string> | null {
  const found = new Map<string, string>();
  const whole = fields(bytes, (field, content) => {
    if (field !== METADATA_PROPS) return;
    let key = "";
    let value = "";
    const text = new TextDecoder();
    fields(content, (inner, part) => {
      if (inner === 1) key = text.decode(part);
      if (inner === 2) value = text.decode(part);
    });
    if (key) found.set(key, value);
  });
  return whole && found.size > 0 ? found : null;
}

/** Calls `visit` for each length-delimited field; false if the bytes are damaged. */
function fields(bytes: Uint8Array, visit: (field: number, content: Uint8Array) => void): boolean {
  let at = 0;
  const varint = (): number => {
    let value = 0;
    for (let shift = 0; shift < 70; shift += 7) {
      const byte = bytes[at++];
      if (byte === undefined) return NaN;
      value += (byte & 127) * 2 ** shift;
      if (byte < 128) return value;
    }
    return NaN;
  };
  while (at < bytes.length) {
    const tag = varint();
    const field = Math.floor(tag / 8);
    switch (tag % 8) {
      case 0:
        if (Number.isNaN(varint())) return false;
        break;
      case 1:
        at += 8;
        break;
      case 2: {
        const length = varint();
        if (!(at + length <= bytes.length)) return false;
        visit(field, bytes.subarray(at, at + length));
        at += length;
        break;
      }
      case 5:
        at += 4;
        break;
      default:
        return false;
    }
  }
  return at === bytes.length;
}
