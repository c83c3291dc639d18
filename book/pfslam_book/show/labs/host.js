// What anywidget calls: the laboratory in a cell's output, and functions of the kernel in the place of ours.
export default {
  render({model, el}) {
    const waiting = new Map(), figure = document.createElement("figure"), caption = document.createElement("figcaption");
    let asked = 0;
    const ask = part => (...values) => new Promise((resolve, reject) => {
      const id = (asked += 1);
      waiting.set(id, {resolve, reject});
      model.send({id, part, arguments: values.map(value => Array.from(value))});
    });
    model.on("msg:custom", message => {
      const {resolve, reject} = waiting.get(message.id);
      waiting.delete(message.id);
      if (message.error) reject(message.error);
      else resolve(message.result.map(values => Float64Array.from(values.flat())));
    });
    figure.className = "pfslam-lab";
    figure.dataset.lmSuppressShortcuts = "true";  // here letters press our buttons, not those of JupyterLab
    caption.textContent = model.get("title");
    figure.append(caption);
    el.append(figure);
    const host = Object.fromEntries(model.get("parts").map(part => [part, ask(part)]));
    globalThis.pfslam.mount(figure, model.get("name"), model.get("options"), host);
  },
};
