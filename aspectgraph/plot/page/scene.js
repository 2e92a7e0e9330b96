/* Draws a part and lines on it with WebGL in parallel projection, and tells which line or face is seen at which pixel.

Notation: the part is held about the centre of its box. The view has the axes right, up and towards the viewer (rows of
`axes`), `scale` pixels to the mm and the point (x, y) mm of the view plane in its middle. All pixels are those of CSS. */
"use strict";

const FACE_VERTEX = `
attribute vec3 position; attribute vec3 normal; attribute vec4 id;
uniform mat4 matrix; uniform mat3 turn; uniform float ids; varying vec4 colour;
void main() {
  gl_Position = matrix * vec4(position, 1.0);
  vec3 n = turn * normal;
  float shade = 0.74 + 0.26 * clamp(dot(n, vec3(-0.30, 0.45, 0.84)), 0.0, 1.0);
  colour = ids > 0.5 ? id : vec4(shade * vec3(0.90, 0.925, 0.95), 1.0);
}`;
const LINE_VERTEX = `
attribute vec3 a; attribute vec3 b; attribute vec2 corner; attribute vec4 id; attribute vec4 style;
uniform mat4 matrix; uniform vec2 size; uniform float ids; uniform float faint; varying vec4 colour;
void main() {
  vec4 p = matrix * vec4(a, 1.0), q = matrix * vec4(b, 1.0), c = corner.x < 0.5 ? p : q;
  vec2 along = (q.xy - p.xy) * size;
  float length_px = length(along);
  vec2 across = length_px > 0.0 ? vec2(-along.y, along.x) / length_px : vec2(0.0);
  float width = style.a * 25.5;
  if (ids > 0.5 && width > 0.0) width = 3.0;
  c.xy += across * corner.y * width / size;
  c.z -= 0.0015;
  gl_Position = width > 0.0 ? c : vec4(2.0, 2.0, 2.0, 1.0);
  colour = ids > 0.5 ? id : vec4(mix(style.rgb, vec3(0.86), faint), 1.0);
}`;
const FRAGMENT = "precision mediump float; varying vec4 colour; void main() { gl_FragColor = colour; }";
const CORNERS = [[0, -1], [1, -1], [1, 1], [0, -1], [1, 1], [0, 1]];

class Scene {
  /* `lines` are lists of points [x, y, z] about the centre; line k has the id k + 1, face f the id lines + f + 1. */
  constructor(canvas, part, lines) {
    this.canvas = canvas;
    this.view = { yaw: 0.64, pitch: 0.61, scale: 1, x: 0, y: 0 };
    this.part = part;
    this.lines = lines;
    this.gl = canvas.getContext("webgl", { antialias: true, alpha: false });
    if (this.gl) this.prepare();
  }

  /* Whether there is a context, and it is not lost. */
  get isReady() { return Boolean(this.gl) && !this.gl.isContextLost(); }

  /* The system may take the graphics card away, as when it sleeps; all on it is made anew when it is back. */
  onLoss(lost, restored) {
    this.canvas.addEventListener("webglcontextlost", (event) => {
      // or else it never comes back
      event.preventDefault();
      lost();
    });
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.prepare();
      restored();
    });
  }

  /* Put programs, faces and lines on the graphics card. */
  prepare() {
    const { lines, part } = this;
    this.targetSize = "";
    this.faceProgram = this.program(FACE_VERTEX);
    this.lineProgram = this.program(LINE_VERTEX);
    this.faces = this.faceBuffers();
    this.named = this.lineBuffers(lines, (k) => k + 1);
    this.rest = this.lineBuffers(part.outlines, () => 0);
    this.paint(this.rest, part.outlines.map(() => [90, 98, 108, 1.0]));
    this.target = this.gl.createFramebuffer();
  }

  program(vertex) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  buffer(values) {
    const gl = this.gl, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    return buffer;
  }

  faceBuffers() {
    const { vertices, triangles, faceOf, normals } = this.part, n = faceOf.length;
    const position = new Float32Array(9 * n), normal = new Float32Array(9 * n), id = new Uint8Array(12 * n);
    for (let corner = 0; corner < 3 * n; corner++) {
      const face = faceOf[(corner / 3) | 0], code = this.lines.length + face + 1;
      for (let i = 0; i < 3; i++) {
        position[3 * corner + i] = vertices[3 * triangles[corner] + i];
        normal[3 * corner + i] = normals[3 * face + i];
      }
      id.set([code & 255, (code >> 8) & 255, code >> 16, 255], 4 * corner);
    }
    return { position: this.buffer(position), normal: this.buffer(normal), id: this.buffer(id), n: 3 * n };
  }

  lineBuffers(lines, idOf) {
    const n = 6 * lines.reduce((sum, line) => sum + line.length - 1, 0);
    const a = new Float32Array(3 * n), b = new Float32Array(3 * n), corner = new Float32Array(2 * n);
    const id = new Uint8Array(4 * n), owner = new Int32Array(n);
    let at = 0;
    lines.forEach((line, k) => {
      const code = idOf(k);
      for (let i = 0; i + 1 < line.length; i++) {
        for (const one of CORNERS) {
          a.set(line[i], 3 * at);
          b.set(line[i + 1], 3 * at);
          corner.set(one, 2 * at);
          id.set([code & 255, (code >> 8) & 255, code >> 16, 255], 4 * at);
          owner[at++] = k;
        }
      }
    });
    const [first, second, side, code] = [a, b, corner, id].map((values) => this.buffer(values));
    return { a: first, b: second, corner: side, id: code, style: this.gl.createBuffer(), owner, n };
  }

  /* Give each line a colour and a width in px: [r, g, b, width], 0 for one that is not shown. */
  paint(buffers, styles) {
    const gl = this.gl, values = new Uint8Array(4 * buffers.n);
    for (let at = 0; at < buffers.n; at++) {
      const [r, g, b, width] = styles[buffers.owner[at]];
      values.set([r, g, b, Math.round(10 * width)], 4 * at);
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers.style);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  }

  get size() { return [Math.max(1, this.canvas.clientWidth), Math.max(1, this.canvas.clientHeight)]; }

  get axes() {
    const { yaw, pitch } = this.view, s = Math.sin(yaw), c = Math.cos(yaw), up = Math.sin(pitch), flat = Math.cos(pitch);
    // yaw 0 looks along +y, at the front
    return [[c, s, 0], [-up * s, up * c, flat], [s * flat, -c * flat, up]];
  }

  /* Return where points are in the picture, px from its upper left corner. */
  project(points) {
    const [right, up] = this.axes, [width, height] = this.size, { scale, x, y } = this.view;
    const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    return points.map((p) => [width / 2 + scale * (dot(p, right) - x), height / 2 - scale * (dot(p, up) - y)]);
  }

  /* Show points, all vertices if none are given, as large as the picture allows. */
  fit(points) {
    const [right, up] = this.axes, [width, height] = this.size;
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity], { vertices } = this.part;
    const all = points ? points.flat() : vertices;
    for (let i = 0; i < all.length; i += 3) {
      [right, up].forEach((axis, k) => {
        const v = axis[0] * all[i] + axis[1] * all[i + 1] + axis[2] * all[i + 2];
        low[k] = Math.min(low[k], v);
        high[k] = Math.max(high[k], v);
      });
    }
    const span = [0, 1].map((k) => Math.max(high[k] - low[k], this.part.radius / 50));
    this.view.scale = 0.82 * Math.min(width / span[0], height / span[1]);
    [this.view.x, this.view.y] = [0, 1].map((k) => (low[k] + high[k]) / 2);
  }

  /* Change the scale; what is at a pixel stays there. */
  zoom(factor, px, py) {
    const [width, height] = this.size, view = this.view, old = view.scale;
    const least = Math.min(width, height) / this.part.radius / 8;
    view.scale = Math.min(Math.max(old * factor, least), 4000 * least);
    view.x += (px - width / 2) * (1 / old - 1 / view.scale);
    view.y -= (py - height / 2) * (1 / old - 1 / view.scale);
  }

  /* Return what to turn about: the part's centre, but from near by the foremost vertex in the middle of the picture. */
  pivot() {
    const { vertices } = this.part, [right, up, towards] = this.axes, { scale, x, y } = this.view;
    const dot = (axis, i) => axis[0] * vertices[i] + axis[1] * vertices[i + 1] + axis[2] * vertices[i + 2];
    const reach = Math.min(...this.size) / 5 / scale;
    let found = [0, 0, 0], nearest = -Infinity;
    if (this.part.radius * scale < 0.75 * Math.max(...this.size)) return found;
    for (let i = 0; i < vertices.length; i += 3) {
      if (Math.hypot(dot(right, i) - x, dot(up, i) - y) < reach && dot(towards, i) > nearest) {
        nearest = dot(towards, i);
        found = [vertices[i], vertices[i + 1], vertices[i + 2]];
      }
    }
    return found;
  }

  /* Turn the view so that a point stays where it is in the picture. */
  keep(point, turn) {
    const [before] = this.project([point]);
    turn();
    const [after] = this.project([point]);
    this.view.x += (after[0] - before[0]) / this.view.scale;
    this.view.y -= (after[1] - before[1]) / this.view.scale;
  }

  matrix() {
    const [width, height] = this.size, [right, up, towards] = this.axes, { scale, x, y } = this.view;
    const rows = [[right, (2 * scale) / width, -x], [up, (2 * scale) / height, -y], [towards, -1 / this.part.radius, 0]];
    const columns = [0, 1, 2].map((i) => [...rows.map(([axis, factor]) => factor * axis[i]), 0]);
    return [...columns.flat(), ...rows.map(([, factor, shift]) => factor * shift), 1];
  }

  bind(program, buffers, layout) {
    const gl = this.gl;
    gl.useProgram(program);
    for (let i = 0; i < 5; i++) gl.disableVertexAttribArray(i);
    for (const [name, count, bytes] of layout) {
      const place = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[name]);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, count, bytes ? gl.UNSIGNED_BYTE : gl.FLOAT, bytes, 0, 0);
    }
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "matrix"), false, this.matrix());
  }

  drawFaces(ids) {
    const gl = this.gl, [r, u, t] = this.axes, program = this.faceProgram;
    this.bind(program, this.faces, [["position", 3, false], ["normal", 3, false], ["id", 4, true]]);
    gl.uniformMatrix3fv(gl.getUniformLocation(program, "turn"), false, [0, 1, 2].flatMap((i) => [r[i], u[i], t[i]]));
    gl.uniform1f(gl.getUniformLocation(program, "ids"), ids);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1.5, 2);
    gl.drawArrays(gl.TRIANGLES, 0, this.faces.n);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  drawLines(buffers, ids, faint = 0) {
    const gl = this.gl, program = this.lineProgram;
    if (!buffers.n) return;
    this.bind(program, buffers, [["a", 3, false], ["b", 3, false], ["corner", 2, false], ["id", 4, true], ["style", 4, true]]);
    gl.uniform2fv(gl.getUniformLocation(program, "size"), this.size);
    gl.uniform1f(gl.getUniformLocation(program, "ids"), ids);
    gl.uniform1f(gl.getUniformLocation(program, "faint"), faint);
    gl.drawArrays(gl.TRIANGLES, 0, buffers.n);
  }

  /* Draw everything; with `through`, hidden lines too, pale. */
  draw(through) {
    const gl = this.gl, [width, height] = this.size, ratio = window.devicePixelRatio || 1;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    this.drawFaces(0);
    this.drawLines(this.rest, 0);
    if (through) {
      gl.depthFunc(gl.GREATER);
      gl.depthMask(false);
      this.drawLines(this.named, 0, 0.62);
      gl.depthMask(true);
      gl.depthFunc(gl.LEQUAL);
    }
    this.drawLines(this.named, 0);
  }

  /* Return the id at each pixel, rows from the bottom: 0 where there is nothing. With `through` no face hides a line. */
  ids(through) {
    const gl = this.gl, [width, height] = this.size;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    if (this.targetSize !== `${width} ${height}`) {
      this.targetSize = `${width} ${height}`;
      const texture = gl.createTexture(), depth = gl.createRenderbuffer();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
      for (const kind of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, kind, gl.NEAREST);
      for (const kind of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, kind, gl.CLAMP_TO_EDGE);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
      gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT16, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    }
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    this.drawFaces(1);
    if (through) gl.clear(gl.DEPTH_BUFFER_BIT);
    this.drawLines(this.named, 1);
    const bytes = new Uint8Array(4 * width * height), codes = new Uint32Array(width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    for (let i = 0; i < codes.length; i++) codes[i] = bytes[4 * i] | (bytes[4 * i + 1] << 8) | (bytes[4 * i + 2] << 16);
    return codes;
  }
}
