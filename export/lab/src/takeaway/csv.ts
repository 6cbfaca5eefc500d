/** Tables as text: comma-separated values (RFC 4180), the heads with units. */

import type { Table } from "../views/context";

export function csv(tables: readonly Table[], address: string): string {
  const parts = tables.map(({ name, head, rows }) => {
    const lines = [head, ...rows].map((row) => row.map(cell).join(","));
    return [cell(`# ${name}`), ...lines].join("\r\n");
  });
  return [cell(`# ${address}`), ...parts].join("\r\n\r\n") + "\r\n";
}

function cell(value: string | number): string {
  const text = typeof value === "number" ? (Number.isFinite(value) ? String(value) : "") : value;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
