/** WebGL: what draws here, and programs. */

const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i; // names of drivers

/** Whether the processor has to draw, as there is no GPU. */
export function isSoftware(gl) {
  const { UNMASKED_RENDERER_WEBGL } = gl.getExtension("WEBGL_debug_renderer_info") ?? {};
  return SOFTWARE.test(gl.getParameter(UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
}

/** A program of a vertex and a fragment shader. */
export function linked(gl, ...sources) {
  const program = gl.createProgram();
  [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((kind, i) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, sources[i]);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    gl.deleteShader(shader); // goes with the program
  });
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error(`This browser's 3D graphics do not work (${gl.getProgramInfoLog(program)}).`);
  }
  return program;
}
