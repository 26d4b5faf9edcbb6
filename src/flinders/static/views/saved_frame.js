/**
 * A frame saved on the graphics card, so that unchanged parts are not drawn again.
 *
 * In software WebGL, drawing twenty thousand points takes longer than the interval of new readings. So the points are drawn
 * once, and new ones are drawn onto the saved frame until the view turns.
 */

export class SavedFrame {
    /** @param {WebGL2RenderingContext} context  without multisampling */
    constructor(context) {
        this.gl = context;
        this.width = 0;
        this.height = 0;
        /** @type {WebGLFramebuffer | null} */
        this.frame = null;
        /** @type {WebGLRenderbuffer | null} */
        this.colours = null;
    }

    /** Save the present canvas. */
    save() {
        const { gl } = this;
        const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
        if (!this.frame || width !== this.width || height !== this.height) this.#make(width, height);
        this.#copy(null, this.frame);
    }

    /**
     * Put the saved frame onto the canvas.
     * @returns {boolean} Whether a frame of this size was saved.
     */
    restore() {
        const { gl } = this;
        if (!this.frame || gl.drawingBufferWidth !== this.width || gl.drawingBufferHeight !== this.height) return false;
        this.#copy(this.frame, null);
        return true;
    }

    /** Delete the frame, for example after the driver has lost it. */
    drop() {
        this.gl.deleteFramebuffer(this.frame);
        this.gl.deleteRenderbuffer(this.colours);
        this.frame = this.colours = null;
    }

    /** @param {number} width @param {number} height */
    #make(width, height) {
        const { gl } = this;
        this.drop();
        [this.width, this.height] = [width, height];
        this.frame = gl.createFramebuffer();
        this.colours = gl.createRenderbuffer();
        gl.bindRenderbuffer(gl.RENDERBUFFER, this.colours);
        gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, width, height);
        gl.bindRenderbuffer(gl.RENDERBUFFER, null);
        gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
        gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, this.colours);
        gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    }

    /** @param {WebGLFramebuffer | null} from  null: the canvas @param {WebGLFramebuffer | null} to */
    #copy(from, to) {
        const { gl, width, height } = this;
        gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from);
        gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to);
        gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
        gl.bindFramebuffer(gl.FRAMEBUFFER, null); // as the renderer left it
    }
}
