// The two programs of the cloud: points by deviation, and shade where a point stands behind its neighbours.

/** Points: colour from the deviation; 1e30 = no deviation. */
export const POINTS = [
  `#version 300 es
  layout(location = 0) in vec4 point;
  uniform mat4 matrix;
  uniform vec3 colours[5];
  uniform float range, size, most;
  out vec3 tint;
  void main() {
    gl_Position = matrix * vec4(point.xyz, 1.0);
    gl_PointSize = clamp(size / gl_Position.w, 1.5, most);
    float at = clamp(point.w / range * 2.0 + 2.0, 0.0, 3.9999);
    int low = int(at);
    tint = point.w > 1e29 ? vec3(0.42, 0.46, 0.5) : mix(colours[low], colours[low + 1], at - float(low));
  }`,
  `#version 300 es
  precision mediump float;
  in vec3 tint;
  out vec4 colour;
  void main() {
    vec2 away = gl_PointCoord - 0.5;
    if (dot(away, away) > 0.25) discard;
    colour = vec4(tint, 1.0);
  }`,
];

/** Eye-dome lighting (Boucheny 2009): the less of the sky a pixel sees, the darker. */
export const EYE = [
  `#version 300 es
  void main() {
    gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
  }`,
  `#version 300 es
  precision highp float;
  uniform sampler2D colour, depth;
  uniform vec2 ends;
  uniform float strength;
  uniform int reach;
  out vec4 shown;
  const ivec2 AROUND[4] = ivec2[](ivec2(1, 0), ivec2(-1, 0), ivec2(0, 1), ivec2(0, -1));
  float away(float d) {
    return d >= 1.0 ? 0.0 : log2(ends.x * ends.y / (ends.y - d * (ends.y - ends.x)));
  }
  void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 own = texelFetch(colour, at, 0);
    vec3 ground = vec3(0.063, 0.086, 0.114);
    if (own.a == 0.0) {
      shown = vec4(ground, 1.0);
      return;
    }
    float here = away(texelFetch(depth, at, 0).r), hidden = 0.0;
    ivec2 last = textureSize(depth, 0) - 1;
    for (int i = 0; i < 4; i++) {
      float d = texelFetch(depth, clamp(at + reach * AROUND[i], ivec2(0), last), 0).r;
      if (d < 1.0) hidden += max(0.0, here - away(d));
    }
    shown = vec4(mix(own.rgb * 0.12, own.rgb, exp(-strength * 0.25 * hidden)), 1.0);
  }`,
];

/** A linked program; `at` = where a uniform stands. */
export function program(gl, [vertex, fragment]) {
  const handle = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(handle, shader);
  }
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(handle));
  const known = new Map();
  const at = (name) => known.get(name) ?? known.set(name, gl.getUniformLocation(handle, name)).get(name);
  return { handle, at };
}
