#version 330 core
// Fragment shader of every mesh: the vertex shader has done the lighting.

#ifdef HAS_BASE_COLOR_TEX
struct Material { sampler2D base_color_texture; };
uniform Material material;
in vec2 uv;
#endif
#ifndef HAS_BASE_COLOR_TEX
in vec3 lit_color;
const float INSIDE = 0.35;
#endif
out vec4 frag_color;

void main() {
#ifdef HAS_BASE_COLOR_TEX
    frag_color = vec4(texture(material.base_color_texture, uv).rgb, 1.0);
#endif
#ifndef HAS_BASE_COLOR_TEX
    // The inside of a sleeve or collar lies in the shade.
    frag_color = vec4(gl_FrontFacing ? lit_color : INSIDE * lit_color, 1.0);
#endif
}
