// Programs of the graphics card: solid shapes, the floor, and depths for shadows.

export const VERTEX = `#version 300 es
layout(location = 0) in vec3 point;
layout(location = 1) in vec3 normal;
uniform mat4 view, model, sun;
out vec3 world, facing;
out vec2 own;
out vec4 lit;
void main() {
  vec4 at = model * vec4(point, 1.0);
  world = at.xyz;
  own = point.xy;
  facing = mat3(model) * normal;
  lit = sun * at;
  gl_Position = view * at;
}`;

const LIGHT = `
uniform highp sampler2DShadow shadows;
uniform vec3 eye, sunward;
in vec3 world, facing;
in vec4 lit;
out vec4 colour;
float sunshine() {
  vec3 at = lit.xyz / lit.w * 0.5 + 0.5;
  if (any(lessThan(at, vec3(0.0))) || any(greaterThan(at, vec3(1.0)))) return 1.0;
  float sum = 0.0;
  for (int i = 0; i < 4; i++) {
    vec2 off = (vec2(i & 1, i >> 1) - 0.5) / 900.0;
    sum += texture(shadows, vec3(at.xy + off, at.z - 0.0015));
  }
  return sum * 0.25;
}`;

export const SOLID = `#version 300 es
precision highp float;
uniform vec4 tint, picture_at;
uniform int pattern, has_picture;
uniform sampler2D picture;
in vec2 own;
${LIGHT}
void main() {
  vec3 n = normalize(facing), base = tint.rgb;
  if (has_picture == 1) base *= texture(picture, (own - picture_at.xy) / picture_at.zw).rgb;
  if (pattern == 1 && abs(n.x) > 0.5) {
    float course = floor(world.z / 0.032);
    vec2 at = vec2(world.y / 0.064 + 0.5 * mod(course, 2.0), world.z / 0.032);
    vec2 near = abs(fract(at) - 0.5), width = fwidth(at);
    float joint = max(smoothstep(0.46 - width.x, 0.47 + width.x, near.x), smoothstep(0.42 - width.y, 0.45 + width.y, near.y));
    base *= mix(1.0, 0.72, joint * clamp(0.35 / max(width.x, width.y), 0.0, 1.0));
  }
  float sun = max(dot(n, sunward), 0.0) * sunshine();
  vec3 towards = normalize(eye - world);
  float shine = pow(max(dot(n, normalize(sunward + towards)), 0.0), 40.0) * sun;
  vec3 ambient = mix(vec3(0.42, 0.41, 0.40), vec3(0.60, 0.62, 0.66), n.z * 0.5 + 0.5);
  colour = vec4(base * (ambient + 0.62 * sun) + 0.16 * shine, tint.a);
}`;

export const FLOOR = `#version 300 es
precision highp float;
uniform vec3 sky;
${LIGHT}
float lines(vec2 at, float half_width) {
  vec2 width = fwidth(at), near = abs(fract(at - 0.5) - 0.5);
  vec2 line = 1.0 - smoothstep(vec2(half_width), vec2(half_width) + 1.5 * width, near);
  return max(line.x, line.y) * clamp(0.4 / max(width.x, width.y), 0.0, 1.0);
}
void main() {
  vec3 base = vec3(0.88, 0.89, 0.905);
  base = mix(base, vec3(0.78, 0.80, 0.83), 0.7 * lines(world.xy * 10.0, 0.006));
  base = mix(base, vec3(0.50, 0.54, 0.60), 0.8 * lines(world.xy, 0.0022));
  base *= 0.80 + 0.20 * sunshine();
  float far = smoothstep(1.5, 7.0, distance(world.xy, eye.xy));
  colour = vec4(mix(base, sky, far), 1.0);
}`;

export const DEPTH = `#version 300 es
precision highp float;
void main() {}`;

export function makeProgram(gl, vertex, fragment) {
  const id = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(id, shader);
  }
  gl.linkProgram(id);
  if (!gl.getProgramParameter(id, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(id));
  const locations = new Map();
  const uniform = (name) => {
    if (!locations.has(name)) locations.set(name, gl.getUniformLocation(id, name));
    return locations.get(name);
  };
  return { id, uniform };
}
