// The association matrix of a scan: kinematic term (K), attribute term (A) and what follows of both.

const LONGEST = 12; // log likelihood ratio of a full bar

const KINDS = {
  ratios: {
    k: "kinematic", a: "attribute", j: "ratio", name: "sum",
    of: (v) => v / LONGEST, signed: true, text: (v) => (v > 0 ? "+" : "") + v.toFixed(1),
  },
  probabilities: {
    k: "p_kinematic", a: "p_attribute", j: "joint_marginal", name: "joint",
    of: (v) => v, signed: false, text: (v) => v.toFixed(3),
  },
};

function term(letter, value, kind) {
  const row = document.createElement("div");
  row.className = `term ${letter}`;
  const name = document.createElement("span");
  name.textContent = letter.toUpperCase();
  const frame = document.createElement("i");
  const text = document.createElement("span");
  if (value === null || value === undefined) {
    text.textContent = "–";
  } else {
    const fill = document.createElement("b");
    const share = Math.max(-1, Math.min(1, kind.of(value)));
    const middle = kind.signed ? 50 : 0;
    const width = Math.abs(share) * (kind.signed ? 50 : 100);
    fill.style.left = `${share < 0 ? middle - width : middle}%`;
    fill.style.width = `${width}%`;
    frame.append(fill);
    text.textContent = kind.text(value);
  }
  row.append(name, frame, text);
  return row;
}

function cell(cells, i, kind, asked) {
  const td = document.createElement("td");
  td.className = cells.chosen[i] ? "chosen" : "";
  td.append(term("k", cells[kind.k][i], kind));
  if (asked) td.append(term("a", cells[kind.a]?.[i], kind));
  const sum = document.createElement("div");
  sum.className = "j";
  const value = cells[kind.j][i];
  sum.textContent = `${kind.name} ${value === null ? "–" : kind.text(value)}${cells.chosen[i] ? " ✓" : ""}`;
  td.append(sum);
  td.title = `squared distance ${cells.mahalanobis_squared[i]}, P_k ${cells.p_kinematic[i]}, ` +
    `P_a ${cells.p_attribute[i]}, joint ${cells.joint_marginal[i]}`;
  return td;
}

export function showMatrix(table, hint, matrix, kindName, selected, select) {
  if (!matrix) {
    hint.textContent = "no pair was in a gate";
    table.replaceChildren();
    return;
  }
  let kind = KINDS[kindName];
  if (!kind.signed && matrix.decided_by === "p_generalised") kind = { ...kind, j: "p_generalised", name: "P_gen" };
  const asked = matrix.attribute_term !== "none";
  const left = matrix.left_out ? `; ${matrix.left_out} more pairs` : "";
  hint.textContent = `${matrix.decision}/${matrix.attribute_term}, decided by ${matrix.decided_by ?? "nothing"}` +
    `${matrix.degraded ? ", degraded" : ""}${left}`;
  const head = document.createElement("tr");
  head.append(document.createElement("th"), ...matrix.columns.map((row) => {
    const th = document.createElement("th");
    th.textContent = `detection ${row}`;
    return th;
  }));
  const body = matrix.rows.track.map((id, r) => {
    const tr = document.createElement("tr");
    const th = document.createElement("th");
    th.textContent = matrix.decision === "mht" ? `track ${id} h${matrix.rows.hypothesis[r]}` : `track ${id}`;
    th.className = id === selected ? "selected" : "";
    th.addEventListener("click", () => select(id));
    tr.append(th, ...matrix.columns.map(() => {
      const td = document.createElement("td");
      td.className = "none";
      td.textContent = "·";
      return td;
    }));
    return tr;
  });
  matrix.cells.row.forEach((r, i) => {
    body[r].replaceChild(cell(matrix.cells, i, kind, asked), body[r].cells[matrix.cells.column[i] + 1]);
  });
  table.replaceChildren(head, ...body);
}
