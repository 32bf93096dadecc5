"use strict";
// Puts a mesh on a canvas by plain WebGL2: texture, relief, depth colours, wireframe.
globalThis.uwPainter = (() => {
  const { bytes, edges, quantile } = globalThis.uwMesh;
  const DEPTH = 3; // the mode that shows a number as a colour; those after it are layers
  const VERTEX = `#version 300 es
    uniform mat4 view, projection;
    uniform vec2 depthRange;
    in vec3 position, normal;
    in vec2 uv;
    in float value;
    uniform bool layered;
    out vec3 eyeNormal, eyePosition;
    out vec2 texel;
    out float shade;
    void main() {
      vec4 eye = view * vec4(position, 1.0);
      eyePosition = eye.xyz;
      eyeNormal = mat3(view) * normal;
      texel = uv;
      float depth = clamp((-position.z - depthRange.x) / max(depthRange.y - depthRange.x, 1e-9), 0.0, 1.0);
      shade = layered ? value : depth;
      gl_Position = projection * eye;
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    uniform sampler2D image, colors;
    uniform int mode;
    in vec3 eyeNormal, eyePosition;
    in vec2 texel;
    in float shade;
    out vec4 color;
    void main() {
      vec3 n = normalize(eyeNormal), toEye = normalize(-eyePosition);
      float lamp = max(dot(n, normalize(vec3(-0.45, 0.6, 0.75))), 0.0), head = max(dot(n, toEye), 0.0);
      float light = 0.22 + 0.55 * lamp + 0.28 * head;
      vec3 base = vec3(0.78, 0.77, 0.74);
      if (mode == 0 || mode == 1) base = texture(image, texel).rgb;
      if (mode == 3) base = texture(colors, vec2(shade, 0.5)).rgb;
      if (mode == 1) base *= 0.35 + 0.85 * light;
      if (mode == 2) base *= light;
      if (mode == 3) base *= 0.55 + 0.5 * light;
      if (!gl_FrontFacing) base = mix(base, vec3(0.35, 0.36, 0.4), 0.75);
      color = vec4(base, 1.0);
    }`;
  const LINE_VERTEX = `#version 300 es
    uniform mat4 view, projection;
    in vec3 position;
    void main() { gl_Position = projection * view * vec4(position, 1.0); gl_Position.z -= 2e-4 * gl_Position.w; }`;
  const LINE_FRAGMENT = `#version 300 es
    precision highp float;
    uniform vec4 ink;
    out vec4 color;
    void main() { color = vec4(ink.rgb * ink.a, ink.a); }`;

  function program(gl, vertex, fragment) {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source.trim());
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    ["position", "normal", "uv", "value"].forEach((name, place) => gl.bindAttribLocation(made, place, name));
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return { made, at: name => gl.getUniformLocation(made, name) };
  }

  class Painter {
    constructor(canvas, mesh, data, whenTextured) {
      this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
      if (!this.gl) throw new Error("this browser offers no WebGL2");
      this.surface = program(this.gl, VERTEX, FRAGMENT);
      this.line = program(this.gl, LINE_VERTEX, LINE_FRAGMENT);
      this.upload(mesh);
      const depths = mesh.positions.filter((_, i) => i % 3 === 2).map(z => -z);
      this.depthRange = [quantile(depths, 0.01), quantile(depths, 0.99)];
      this.uploadColors(1, data.colors);
      this.layers = data.layers.map((layer, k) => this.uploadLayer(2 + k, layer));
      this.uploadTexture(data.texture, whenTextured);
    }

    upload({ positions, normals, uv, index, n }) {
      const gl = this.gl, lines = edges(index, n);
      gl.bindVertexArray(gl.createVertexArray());
      [[positions, 3], [normals, 3], [uv, 2]].forEach(([values, size], place) => {
        this.store(gl.ARRAY_BUFFER, values);
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
      });
      this.faces = this.store(gl.ELEMENT_ARRAY_BUFFER, index);
      this.edges = this.store(gl.ELEMENT_ARRAY_BUFFER, lines);
    }

    store(target, values) {
      const buffer = this.gl.createBuffer();
      this.gl.bindBuffer(target, buffer);
      this.gl.bufferData(target, values, this.gl.STATIC_DRAW);
      return { buffer, count: values.length };
    }

    texture(unit, filter) {
      const gl = this.gl;
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    }

    // A number at every vertex, and the colours it is shown in.
    uploadLayer(unit, { values, colors }) {
      this.uploadColors(unit, colors);
      return { unit, ...this.store(this.gl.ARRAY_BUFFER, new Uint8Array(bytes(values))) };
    }

    // The attribute that a layer is; none: depth.
    choose(layer) {
      const gl = this.gl;
      gl.uniform1i(this.surface.at("colors"), layer ? layer.unit : 1);
      gl.uniform1i(this.surface.at("layered"), layer ? 1 : 0);
      if (!layer) return gl.disableVertexAttribArray(3);
      gl.bindBuffer(gl.ARRAY_BUFFER, layer.buffer);
      gl.enableVertexAttribArray(3);
      gl.vertexAttribPointer(3, 1, gl.UNSIGNED_BYTE, true, 0, 0);
    }

    uploadColors(unit, colors) {
      const gl = this.gl;
      this.texture(unit, gl.LINEAR);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, new Uint8Array(bytes(colors)));
    }

    // Grey until the picture is decoded.
    uploadTexture(uri, whenTextured) {
      const gl = this.gl, picture = new Image();
      this.texture(0, gl.LINEAR_MIPMAP_LINEAR);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 1, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, new Uint8Array([128, 128, 128, 0]));
      picture.onload = () => {
        const sharp = gl.getExtension("EXT_texture_filter_anisotropic");
        gl.activeTexture(gl.TEXTURE0);
        gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, true);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE, picture);
        gl.generateMipmap(gl.TEXTURE_2D);
        if (sharp) gl.texParameterf(gl.TEXTURE_2D, sharp.TEXTURE_MAX_ANISOTROPY_EXT, 8);
        whenTextured();
      };
      picture.src = uri;
    }

    paint({ view, projection }, mode, wire) {
      const gl = this.gl;
      gl.viewport(0, 0, gl.canvas.width, gl.canvas.height);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      gl.disable(gl.BLEND);
      this.use(this.surface, view, projection);
      gl.uniform1i(this.surface.at("image"), 0);
      gl.uniform1i(this.surface.at("mode"), Math.min(mode, DEPTH));
      this.choose(this.layers[mode - DEPTH - 1]);
      gl.uniform2fv(this.surface.at("depthRange"), this.depthRange);
      this.draw(gl.TRIANGLES, this.faces);
      if (!wire) return;
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      this.use(this.line, view, projection);
      gl.uniform4fv(this.line.at("ink"), mode === 2 ? [0.05, 0.2, 0.4, 0.55] : [1, 1, 1, 0.4]);
      this.draw(gl.LINES, this.edges);
    }

    use(shaders, view, projection) {
      this.gl.useProgram(shaders.made);
      this.gl.uniformMatrix4fv(shaders.at("view"), false, view);
      this.gl.uniformMatrix4fv(shaders.at("projection"), false, projection);
    }

    draw(what, { buffer, count }) {
      this.gl.bindBuffer(this.gl.ELEMENT_ARRAY_BUFFER, buffer);
      this.gl.drawElements(what, count, this.gl.UNSIGNED_INT, 0);
    }
  }

  return Painter;
})();
