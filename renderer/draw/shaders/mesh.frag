#version 330 core
// Fragment shader of every mesh: the vertex shader has done the lighting.

#ifdef HAS_BASE_COLOR_TEX
in vec2 uv;
#ifdef COLOR_0_LOC
struct Material {
    vec4 base_color_factor;
    float roughness_factor;
    sampler2D base_color_texture;
};
in vec3 lit_color;
in vec3 gloss_color;
const float EXPOSURE = 1.12;  // as in mesh.vert, and the next
const float ROLL_OFF = 0.22;
#endif
#ifndef COLOR_0_LOC
struct Material { sampler2D base_color_texture; };
#endif
uniform Material material;
#endif
#ifndef HAS_BASE_COLOR_TEX
in vec3 lit_color;
const float INSIDE = 0.35;
#endif
out vec4 frag_color;

void main() {
#ifdef HAS_BASE_COLOR_TEX
    vec4 texel = texture(material.base_color_texture, uv);
#ifdef COLOR_0_LOC
    if (texel.a < 0.5) discard;  // between the strands of hair
    vec3 color = lit_color * texel.rgb * texel.rgb + gloss_color;
    texel.rgb = sqrt(clamp(EXPOSURE * color / (1.0 + ROLL_OFF * color), 0.0, 1.0));
#endif
    frag_color = vec4(texel.rgb, 1.0);
#endif
#ifndef HAS_BASE_COLOR_TEX
    // The inside of a sleeve or collar lies in the shade.
    frag_color = vec4(gl_FrontFacing ? lit_color : INSIDE * lit_color, 1.0);
#endif
}
